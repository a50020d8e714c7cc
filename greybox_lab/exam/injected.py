"""Tier injected: exactly altered stretches of real recordings, the same stretches unaltered, and recordings from
before.

The question is what changed since. The size of a fault relative to the scatter between unaltered stretches of that
vehicle is measured by plain regressions (`altering.scatter_between`) before any diagnosis, and sealed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from greybox_id.base.errors import BadInput, near
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.how import Say
from greybox_id.models.registry import build, motion_model_of
from greybox_id.models.vehicle import vehicle

from .altering import INJECTIONS, Injection, altered, scatter_between
from .answers import Answer
from .make import Exam, make_cases
from .real import ChangedCase, lacking, shuffled

Stretch = tuple[str, float, float]
"""A file in the data folder, and start and end of the stretch as shares of its rows."""


@dataclass(frozen=True)
class InjectedSource:
    """Real recordings of a vehicle.

    Attributes
    ----------
    columns, vehicle, model : column map, shipped vehicle, and model instead of its own; "" for its own.
    seconds, rate : approximate length of a case's recording, and rows per second after thinning.
    before, after : stretches for recordings from before and from after.
    derived : signals computed from others: they have no sensor that could be faulty.
    """

    columns: str
    vehicle: str
    model: str
    seconds: float
    rate: float
    before: tuple[Stretch, ...]
    after: tuple[Stretch, ...]
    derived: tuple[str, ...] = ()

    @property
    def files(self) -> tuple[str, ...]:
        """All its files."""
        return tuple(dict.fromkeys(name for name, _, _ in (*self.before, *self.after)))


def _whole(*names: str) -> tuple[Stretch, ...]:
    return tuple((name, 0.0, 1.0) for name in names)


_FREE = _whole("dart/free_1002.csv.gz", "dart/free_1012.csv.gz", "dart/free_1027.csv.gz")
_TRAIN, _TRUCK = _whole("roboracer/train.csv"), _whole("truck/train.parquet")
_LAP = "revs_250lm/run1_first400s.csv.gz"
SOURCES: Mapping[str, InjectedSource] = {
    "dart_free": InjectedSource("dart", "dart", "", 30.0, 100.0, _FREE, _FREE, ("a_x", "a_y")),
    "roboracer_train": InjectedSource("roboracer", "roboracer", "", 25.0, 20.0, _TRAIN, _TRAIN),
    "truck_train": InjectedSource("truck", "truck", "lateral", 60.0, 50.0, _TRUCK, _TRUCK),
    "ferrari_first": InjectedSource("revs_250lm", "ferrari_250lm", "lateral", 30.0, 50.0, ((_LAP, 0.0, 0.5),),
                                    ((_LAP, 0.0, 0.5),)),
    "dart_laps": InjectedSource("dart", "dart", "", 13.0, 20.0, _whole("dart/mpcc_apr08_1801.csv.gz"),
                                _whole("dart/mpcc_apr04_1523.csv.gz"), ("a_x", "a_y")),
    "roboracer": InjectedSource("roboracer", "roboracer", "", 30.0, 20.0, _TRAIN, _whole("roboracer/valid.csv")),
    "truck": InjectedSource("truck", "truck", "lateral", 60.0, 50.0, _TRUCK, _whole("truck/val.parquet")),
    "ferrari": InjectedSource("revs_250lm", "ferrari_250lm", "lateral", 30.0, 50.0, ((_LAP, 0.0, 0.5),),
                              ((_LAP, 0.5, 1.0),)),
}  # fmt: skip
"""Sources for development and for examination; recordings diagnosed in an examination are not used in development."""
DEVELOPMENT = ("dart_free", "roboracer_train", "truck_train", "ferrari_first")
EXAMINATION = ("dart_laps", "roboracer", "truck", "ferrari")
SETS: Mapping[str, tuple[str, ...]] = {"development": DEVELOPMENT, "examination": EXAMINATION}

LEAST, MOST = 3.0, 8.0
"""Range of a fault in scatters; faults below `answers.ABOVE` should be passed over, or named correctly."""
LEAST_SPEED = 0.15
"""Least mean speed of a recording, relative to the vehicle's highest: at rest, nothing is detectable."""
RUNS = 3
"""Number of recordings from before."""


def sources(target: Sequence[str]) -> tuple[str, ...]:
    """Names of sources, with sets expanded; by default those of the set "examination"."""
    result = [name for item in target or ("examination",) for name in SETS.get(item, (item,))]
    for name in result:
        if name not in SOURCES:
            raise BadInput(f'There is no source "{name}" of recordings{near(name, [*SOURCES, *SETS])}')
    return tuple(dict.fromkeys(result))


def make_injected(
    folder: Path, data: Path, seed: int, singles: int, target: Sequence[str], jobs: int, say: Say
) -> Exam:
    """Make cases of altered real recordings, and of the same recordings unaltered.

    Parameters
    ----------
    folder : new, empty, or unfinished from the same request.
    data : folder with the folders of recordings.
    seed : of recordings, effects and magnitudes.
    singles : number of altered ones; there are as many nulls.
    target : sources, or sets of them; by default the set "examination".
    jobs : number of parallel processes.
    say : called with progress.

    Raises
    ------
    BadInput : if a recording is missing, or the folder contains something else.
    """
    if singles < 1:
        raise BadInput("An examination needs at least one case; ask for some with ‹singles›.")
    names = sources(target)
    if missing := lacking(data, [file for name in names for file in SOURCES[name].files]):
        raise BadInput(f"{data} holds no {', '.join(missing)}. Name the folder of the recordings with ‹data›.")
    rng = np.random.default_rng((seed, 61031))
    pools = []
    for name in names:
        say(f"reading {name}")
        pools.append(Pool.of(name, data))
    drawn = [case for k in range(singles) for case in pools[k % len(pools)].drawn(rng, seed)]
    cases = {
        case: partial(replace(item, answer=replace(item.answer, case=case)).written, folder)
        for case, item in zip(shuffled(len(drawn), seed), drawn, strict=True)
    }
    requested = {"tier": "injected", "seed": seed, "singles": singles, "sources": list(names), "data": str(data)}
    return make_cases(folder, requested, dict(sorted(cases.items())), jobs, say)


@dataclass(frozen=True)
class Pool:
    """Recordings from which cases are drawn.

    Attributes
    ----------
    name : of the source.
    before, after : recordings.
    scatter : injection that the signals allow -> standard deviation between all recordings.
    """

    name: str
    before: tuple[Recording, ...]
    after: tuple[Recording, ...]
    scatter: Mapping[str, float]

    @classmethod
    def of(cls, name: str, data: Path) -> Pool:
        """Read a source and divide it into recordings."""
        source = SOURCES[name]
        files = {file: _thinned(read(data / file, source.columns), source.rate) for file in source.files}
        before, after = (_cut(files, part, source.seconds) for part in (source.before, source.after))
        stated = vehicle(source.vehicle)
        model = build(source.model, vehicle=stated) if source.model else motion_model_of(stated)
        every = before if source.before == source.after else (*before, *after)
        scatter = scatter_between(every)
        measured = set(model.outputs) - set(source.derived)
        able = {key: scatter[key] for key, one in INJECTIONS.items() if key in scatter and _shows(one, every, measured)}
        return cls(name, before, after, able)

    def drawn(self, rng: np.random.Generator, seed: int) -> tuple[ChangedCase, ChangedCase]:
        """An altered case, and the same unaltered."""
        source = SOURCES[self.name]
        if source.before == source.after:
            several = [self.before[k] for k in rng.permutation(len(self.before))[: RUNS + 2]]
            before, after = several[:RUNS], several[RUNS:]
        else:
            before = [self.before[k] for k in rng.permutation(len(self.before))[:RUNS]]
            after = [self.after[k] for k in rng.permutation(len(self.after))[:2]]
        name = list(self.scatter)[int(rng.integers(len(self.scatter)))]
        size = _magnitude(INJECTIONS[name], self.scatter[name], rng)
        about = {"source": self.name, "after": [f"{one.name} from {one.time[0]:g} s" for one in after]}
        plain = Answer("", "null", "injected", {}, seed=seed, about=about)
        null = ChangedCase(source.vehicle, source.model, before, after, plain)
        answer = Answer("", "single", "injected", {name: size}, {name: INJECTIONS[name].null}, seed=seed, about=about,
                        scatter={name: self.scatter[name]})  # fmt: skip
        return replace(null, after=[altered(one, name, size) for one in after], answer=answer), null


def _shows(injection: Injection, recordings: Sequence[Recording], measured: Collection[str]) -> bool:
    """Whether the altered signals are recorded, and used by the model."""
    there = all(signal in one for one in recordings for signal in injection.needs)
    return there and (not injection.outputs or set(injection.needs) <= set(measured))


def _magnitude(injection: Injection, scatter: float, rng: np.random.Generator) -> float:
    size = min(scatter * float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST)))), injection.most)
    down = injection.sides and rng.random() < 0.5
    if injection.null == 1.0:
        return float(np.exp(-size if down else size))
    return -size if down else size


def _cut(files: Mapping[str, Recording], stretches: Sequence[Stretch], seconds: float) -> tuple[Recording, ...]:
    """Consecutive moving recordings of about this length."""
    result = []
    for name, low, high in stretches:
        stretch = files[name].rows(round(low * len(files[name])), round(high * len(files[name])))
        fastest = np.nanmax(np.abs(stretch["v_x"]))
        edges = (
            np.linspace(0, len(stretch), max(1, round(len(stretch) * stretch.sample_time / seconds)) + 1)
            .round()
            .astype(int)
        )
        parts = (stretch.rows(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True))
        result += [part for part in parts if np.nanmean(np.abs(part["v_x"])) > LEAST_SPEED * fastest]
    return tuple(result)


def _thinned(recording: Recording, rate: float) -> Recording:
    """About this number of rows per second of each run."""
    return recording.every(max(1, round(1 / (rate * recording.sample_time))))
