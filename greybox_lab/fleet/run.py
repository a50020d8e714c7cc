"""Running a fleet: every recording that is not done yet, on an engine, its results kept as they come.

Recordings that an earlier run has done and that are done again since something else is asked of them: why.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from greybox_id.base.contained.process import Broken
from greybox_id.base.declared import understood
from greybox_id.base.errors import BadInput, must_be_one_of, must_be_whole
from greybox_id.base.files import write_atomically
from greybox_id.base.guard import protect
from greybox_id.base.json_data import attributes
from greybox_id.base.numbers import counted
from greybox_id.base.processes import duration

from .engines import engine as engine_of
from .manifest import FleetEntry, entries
from .plan import FleetPlan, content_of, plan_of
from .prior import second_pass
from .status import FleetProgress, Watch
from .statuses import BROKEN, FAILED, FIT, NOT_TRUSTED
from .store import COLUMNS, OF_RESULTS, Journal, Store
from .unit import MADE_BY

NOT_GIVEN = "not given"


def anew(
    todo: Sequence[FleetEntry], earlier: Mapping[str, tuple[str, str]], done: Collection[str], why: Sequence[str]
) -> str:
    """How many of the recordings to be done are as they were and were done before, and why they are done again.

    Parameters
    ----------
    todo : what is to be done.
    earlier : path -> hash and key of the last run's recordings.
    done : keys that have a result.
    why : what differs from the last run, as `differences` says it.

    Returns
    -------
    A sentence; "" where there are none.
    """
    count = 0
    for entry in todo:
        digest, key = earlier.get(entry.path, ("", ""))
        count += bool(entry.sha256) and entry.sha256 == digest and entry.key != key and key in done
    if not count:
        return ""
    verb = "is" if count == 1 else "are"
    reason = "; ".join(why) or "a vehicle file, or a recording's vehicle, has changed"
    return f"{counted(count, 'recording')} done by an earlier run {verb} done again: {reason}."


def origin_of(file: Path) -> dict[str, Any]:
    """What the last run was asked for; nothing where that cannot be read."""
    try:
        body = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return body if isinstance(body, dict) else {}


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What is asked of every recording now and was not before, in words."""
    if not before:
        return []
    result = [
        _said(name, before.get(name), now[name]) for name in ("version", "steps") if before.get(name) != now[name]
    ]
    for step in now["steps"]:
        old, new = (_options(item, step) for item in (before, now))
        names = [name for name in sorted({*old, *new}) if old.get(name) != new.get(name)]
        result += [_said(f"[{step}] {name}", old.get(name), new.get(name)) for name in names]
    if before.get("columns") != now["columns"]:
        result.append(_said("columns", before.get("columns"), now["columns"]))
    elif before.get("map", now["map"]) != now["map"]:
        result.append(f"the column map {now['columns']} has changed")
    return result


def _options(origin: Mapping[str, Any], step: str) -> Mapping[str, Any]:
    options = origin.get("options")
    chosen = options.get(step) if isinstance(options, dict) else None
    return chosen if isinstance(chosen, dict) else {}


def _said(name: str, old: Any, new: Any) -> str:
    was, now = (NOT_GIVEN if item is None else json.dumps(item, ensure_ascii=False, default=str) for item in (old, new))
    return f"{name} was {was} and is {now}"


ENGINES = ("local", "dask")
ONLY = ("all", "changed")
ORIGIN = "fleet.json"
"""What the last run was asked for, in the folder of its results."""
SETTLE = 30.0
"""s between parts, while results come."""


@dataclass(frozen=True)
class FleetRun:
    """What came of a run.

    Attributes
    ----------
    recordings : that the fleet has.
    done : ended by this run, whatever came of them.
    failed : of the fleet's recordings, how many have no result: failed, over a limit of time or of memory.
    not_trusted : how many the check forbids trusting.
    skipped : done by earlier runs.
    refitted : fitted again by this run, with what the fleet has as their prior.
    cpu_seconds, seconds : of the processor in units of work, and by the clock.
    anew : how many recordings that earlier runs had done this one did again, and why; "" where there were none.
    folder : where the results are.
    """

    recordings: int
    done: int
    failed: int
    not_trusted: int
    skipped: int
    refitted: int
    cpu_seconds: float
    seconds: float
    anew: str
    folder: Path

    def to_json(self) -> dict[str, Any]:
        """The same as plain data."""
        return {**vars(self), "folder": str(self.folder)}

    def summary(self) -> str:
        """The same in lines."""
        again = (
            f"again    {self.refitted} recordings fitted a second time, with the fleet's mean and spread as prior\n"
            if self.refitted
            else ""
        )
        why = f"why      greybox fleet status {self.folder}\n" if self.failed else ""
        anew = f"anew     {self.anew}\n" if self.anew else ""
        return (
            f"fleet    {counted(self.recordings, 'recording')}: {self.done} done, {self.skipped} done before; "
            f"{self.failed} without a result, {self.not_trusted} not to be trusted\n{anew}{why}{again}"
            f"took     {duration(self.seconds)}, {self.cpu_seconds:.1f} CPU s\n"
            f"written  {self.folder}   next: greybox fleet estimate {self.folder}"
        )


@understood
def run(
    plan: str | Path | FleetPlan,
    out: str | Path,
    *,
    engine: Literal["local", "dask"] = "local",
    scheduler: str | None = None,
    jobs: int = 1,
    only: Literal["all", "changed"] = "all",
    retry_failed: bool = False,
    compact: bool = False,
    refit: bool = False,
    progress: Watch | None = None,
) -> FleetRun:
    """Check, fit and diagnose the recordings of a fleet; what is done already is not done again.

    Killed at any moment, it carries on where it was when it is called again.

    Parameters
    ----------
    plan : fleet.toml.
    out : folder of the results: Parquet datasets `recordings`, `parameters`, `covariances`, `gaps` and `manifest`.
    engine : "local", processes of this machine; "dask", workers of Dask.
    scheduler : with "dask", address of the scheduler whose workers do the work; None starts workers here.
    jobs : recordings at a time on this machine.
    only : "changed" takes files whose size and time of change are as they were for unchanged, and does not read them.
    retry_failed : do again what failed or met a limit.
    compact : write the results as one part each, without those of recordings that changed or are gone.
    refit : in the end fit what is poorly excited or lies apart again, once, with the fleet's mean and spread as prior.
    progress : is handed the progress as it goes.

    Returns
    -------
    FleetRun
        How many recordings were done, skipped, failed.

    Raises
    ------
    BadInput : the plan or its manifest cannot be read, the folder holds something else, another run is at work, or the
        engine cannot be had.

    Examples
    --------
    >>> from greybox_lab import fleet
    >>> fleet.run("no_fleet.toml", "results")
    Traceback (most recent call last):
    ...
    greybox_id.base.errors.BadInput: no_fleet.toml cannot be read: No such file or directory. ...
    """
    must_be_one_of(ENGINES, engine, "engine: there is no engine")
    must_be_one_of(ONLY, only, "only: there is no")
    if scheduler is not None and engine != "dask":
        raise BadInput("‹scheduler› is for the engine dask; add ‹engine› dask.")
    must_be_whole(jobs, "jobs", 1)
    requested = plan if isinstance(plan, FleetPlan) else plan_of(plan)
    protect(requested.file)
    began = time.monotonic()
    watch = progress or _unseen
    with Store(out).opened() as store:
        fleet = entries(requested, _known(store) if only == "changed" else None)
        earlier, origin = _earlier(store), _origin(requested)
        why = differences(origin_of(store.folder / ORIGIN), origin)
        store.replace("manifest", [attributes(entry, *COLUMNS["manifest"]) for entry in fleet])
        write_atomically(store.folder / ORIGIN, json.dumps(origin, indent=1) + "\n", continued=True)
        done = store.done()
        target = {entry.key for entry in fleet}
        target |= {_again(key) for key in target}
        again = {key for key, status in done.items() if retry_failed and status in BROKEN and key in target}
        if again or compact:
            store.keep({key for key in done if key not in again and (key in target or not compact)})
            done = {key: status for key, status in done.items() if key not in again}
        todo = [entry for entry in fleet if entry.key not in done]
        shown = FleetProgress(todo=len(todo), skipped=len(fleet) - len(todo), anew=anew(todo, earlier, done, why))
        if todo:
            _work(requested, store, todo, (engine, jobs, scheduler), shown, watch)
        second = _refitted(requested, store, fleet, (engine, jobs, scheduler), watch) if refit else FleetProgress()
        done = store.done()
        statuses = Counter(done[entry.key] for entry in fleet)
    return FleetRun(
        recordings=len(fleet),
        done=shown.done,
        failed=sum(statuses[status] for status in BROKEN),
        not_trusted=statuses[NOT_TRUSTED],
        skipped=shown.skipped,
        refitted=second.done,
        cpu_seconds=round(shown.cpu_seconds + second.cpu_seconds, 3),
        seconds=round(time.monotonic() - began, 3),
        anew=shown.anew,
        folder=store.folder,
    )


def _work(
    plan: FleetPlan,
    store: Store,
    todo: list[FleetEntry],
    on: tuple[str, int, str | None],
    shown: FleetProgress,
    watch: Watch,
    refit_of: Mapping[str, str] | None = None,
) -> None:
    """Have it all done, and keep what comes of it."""
    by_key, firsts = {entry.key: entry for entry in todo}, refit_of or {}
    journal = store.journal()

    def take(result: dict[str, Any]) -> None:
        entry = by_key[result["key"]]
        journal.add(rows_of(entry, result, firsts.get(entry.key)))
        shown.took(entry.vehicle, result)
        watch(shown)

    for entry in todo:
        if entry.problem:
            take({"key": entry.key, "status": FAILED, "sentence": entry.problem, "version": MADE_BY})
    sound = [entry for entry in todo if not entry.problem]
    try:
        if sound:
            with engine_of(*on[:2], on[2]) as hands:
                shown.dashboard, shown.lacks = hands.address, hands.lacks
                watch(shown)
                _drained(hands.results(_jobs(plan, sound)), take, journal)
    except Broken as error:
        raise BadInput(str(error)) from error
    finally:
        journal.settle()


def _refitted(
    plan: FleetPlan, store: Store, fleet: list[FleetEntry], on: tuple[str, int, str | None], watch: Watch
) -> FleetProgress:  # fmt: skip
    """Fit again what gains by the fleet's prior; what was fitted again once is left as it is.

    The prior is kept with each fit and is taken off when fits are joined, whatever it was then. So a fleet that grows
    need not do its second pass anew.
    """
    if FIT not in plan.steps:
        raise BadInput(f"{plan.file}: a second pass repeats the step fit, which is not in steps.")
    result, done = second_pass(store), store.done()
    todo = [replace(entry, key=_again(entry.key)) for entry in fleet if entry.key in result.keys]
    todo = [entry for entry in todo if entry.key not in done]
    shown = FleetProgress(todo=len(todo), skipped=len(result.keys) - len(todo))
    if todo:
        value = plan.options.get(FIT, {})
        fit = {**value, "prior": [*result.beside(value.get("prior", ())), *result.priors]}
        second = replace(plan, steps=(FIT,), options={**plan.options, FIT: fit})
        _work(second, store, todo, on, shown, watch, {_again(key): key for key in result.keys})
    return shown


def _again(key: str) -> str:
    """The key of a recording's second fit."""
    return hashlib.sha256(f"{key} again".encode()).hexdigest()


def _drained(results: Iterator[dict[str, Any]], take: Callable[[dict[str, Any]], None], journal: Journal) -> None:
    settled = time.monotonic()
    for result in results:
        take(result)
        if time.monotonic() - settled > SETTLE:
            journal.settle()
            settled = time.monotonic()


def _jobs(plan: FleetPlan, todo: list[FleetEntry]) -> Iterator[str]:
    """Jobs as `engines.done` takes them."""
    common = {"columns": plan.columns, "steps": list(plan.steps), "seconds": plan.seconds, "memory": plan.memory}
    for entry in todo:
        value = {
            "key": entry.key, "path": str(entry.file.resolve()), "shown": entry.path, "sha256": entry.sha256,
            "vehicle": entry.vehicle_file or None,
        }  # fmt: skip
        yield json.dumps({**common, **value, **plan.options})


def rows_of(
    entry: FleetEntry, result: Mapping[str, Any], refit_of: str | None = None
) -> dict[str, list[dict[str, Any]]]:  # fmt: skip
    """The rows of all datasets that a result is; `refit_of` is the key of the first fit where it is the second."""
    outcome = {"key": entry.key, "vehicle": entry.vehicle, "time": entry.time}
    named = {"path": entry.path, "odometer": entry.odometer, "tags": entry.tags, "refit_of": refit_of}
    known = {name: value for name, value in result.items() if name not in OF_RESULTS}
    rows: dict[str, list[dict[str, Any]]] = {"recordings": [{**known, **outcome, **named}]}
    for name in OF_RESULTS[1:]:
        rows[name] = [{**row, **outcome} for row in result.get(name, ())]
    return rows


def _known(store: Store) -> dict[str, tuple[int, int, str]]:
    """What earlier runs know of files: path -> size, time of change, hash."""
    table = store.read("manifest")
    table = table[table["sha256"] != ""]
    return {
        str(path): (int(size), int(changed), str(digest))
        for path, size, changed, digest in zip(
            table["path"], table["size"], table["changed"], table["sha256"], strict=True
        )
    }


def _earlier(store: Store) -> dict[str, tuple[str, str]]:
    """The last run's recordings: path -> hash and key."""
    table = store.read("manifest")
    return {
        str(path): (str(digest), str(key))
        for path, digest, key in zip(table["path"], table["sha256"], table["key"], strict=True)
    }


def _origin(plan: FleetPlan) -> dict[str, Any]:
    """What a run was asked for, as plain data."""
    body = {
        "version": MADE_BY, "plan": str(plan.file.resolve()), "recordings": plan.recordings, "vehicle": plan.vehicle,
        "columns": plan.columns, "steps": plan.steps, "options": plan.options, "seconds": plan.seconds,
        "memory": plan.memory, "map": content_of(plan.columns),
    }  # fmt: skip
    plain: dict[str, Any] = json.loads(json.dumps(body, default=str))
    return plain


def _unseen(progress: FleetProgress) -> None:
    del progress
