"""`greybox gap AFTER.. --since BEFORE..` on recordings of a real car whose changes are known, run as a user runs it.

    python benchmarks/changed.py --data DIR [--out FOLDER] [--json] [--quick] [--development] [--cases NAME ...]

DIR holds dart/*.csv.gz, recordings of a 1:10 car by Lyons et al. Cases:

changed: tyres taped, on a throttle ramp and drifting, and a slippery floor: grip must be first. How much is lost is
read off saturated lateral acceleration, its 95th percentile over that before; of the ramps at like steering.

unchanged: recordings of the same condition, some of them months apart: nothing may be named.

injected: the steering command given 80 ms earlier, 20 mrad less or at a ninth more, and the yaw rate times 1.05,
exactly and in both recordings from after: five pairs each. Right: the name, and no other; silent: none; wrong: another.

Every case is a file in FOLDER, and is not run again: `case`, `kind`, `first`, `magnitude`, `sd`, `applied`, `truth`,
`verdict`, `gain`, `cpu_seconds`. `--quick` runs one case of each kind.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from greybox_id.datasets.read import read
from greybox_id.exam.make import write_recording
from greybox_id.exam.real import altered
from greybox_id.files import write_atomically
from greybox_id.recording import Recording

INJECTED = {
    "delay": ("steering_delay", 0.08), "offset": ("steering_offset", 0.02), "ratio": ("steering_ratio", 0.9),
    "yaw_rate": ("yaw_rate_scale", 1.05),
}  # fmt: skip
SATURATED = 95.0
"""Percentile of |a_y| that is taken for saturated."""
SIGNALS = ("v_x", "v_y", "yaw_rate", "a_x", "a_y", "steer", "throttle")


@dataclass(frozen=True)
class Case:
    """Recordings before and after, by name; "/1" and "/2" are halves.

    Attributes
    ----------
    kind : "changed", "unchanged" or "injected".
    before, after, held_out : recordings.
    truth : the effect that changed; "" for none.
    like : recordings from before, driven alike, to which saturated lateral acceleration is compared.
    injected : of `INJECTED`; "" for none.
    """

    kind: str
    before: tuple[str, ...]
    after: tuple[str, ...]
    held_out: tuple[str, ...] = ()
    truth: str = ""
    like: tuple[str, ...] = ()
    injected: str = ""


TAPED = ("tape_ramp_1805_pos03", "tape_ramp_1758_neg03")
RAMPS = ("ramp_1529", "ramp_1534", "ramp_1653_neg03")
MIXED = ("free_1002", "free_1027", "ramp_1653_neg03")
LAPS = ("mpcc_apr04_1523", "mpcc_apr08_1801")
PAIRS = {
    "free_a": Case("injected", ("free_1002",), ("free_1012",), ("free_1027",)),
    "free_b": Case("injected", ("free_1027",), ("free_1002",), ("free_1012",)),
    "free_c": Case("injected", ("free_1012",), ("free_1002",), ("free_1027",)),
    "laps_a": Case("injected", LAPS[:1], ("mpcc_apr08_1801/1",), ("mpcc_apr08_1801/2",)),
    "laps_b": Case("injected", LAPS[1:], ("mpcc_apr04_1523/1",), ("mpcc_apr04_1523/2",)),
}
CASES: Mapping[str, Case] = {
    "slippery": Case("changed", LAPS, ("mpcc_apr16_1621_slippery",), ("slippery_apr16_1556",), "grip_scale", LAPS),
    "tape_ramp": Case("changed", RAMPS, TAPED[:1], TAPED[1:], "grip_scale", RAMPS[2:]),
    "tape_drift": Case("changed", MIXED, ("tape_drift_1813",), (), "grip_scale"),
    "ramps_a": Case("unchanged", RAMPS[:2], ("ramp_1605_pos015",), ("ramp_1609_neg015",)),
    "ramps_b": Case("unchanged", ("ramp_1605_pos015", "ramp_1609_neg015"), ("ramp_1615_neg02",), ("ramp_1653_neg03",)),
    "free_two": Case("unchanged", ("free_1002", "free_1012"), ("free_1027",)),
    **{f"{name}_null": replace(own, kind="unchanged") for name, own in PAIRS.items()},
    **{f"{name}_{what}": replace(own, truth=INJECTED[what][0], injected=what)
       for what in INJECTED for name, own in PAIRS.items()},
}  # fmt: skip
DEVELOPMENT: Mapping[str, Case] = {
    f"development_{k}": Case("unchanged", before, after, held_out) for k, (before, after, held_out) in enumerate((
        (("free_1002",), ("free_1027/1",), ("free_1027/2",)),
        (("free_1012",), ("free_1002/1",), ("free_1002/2",)),
        (("free_1027",), ("free_1012/1",), ("free_1012/2",)),
        (("free_1002",), ("free_1012",), ()),
        (("slippery_apr16_1556",), ("mpcc_apr16_1621_slippery/1",), ("mpcc_apr16_1621_slippery/2",)),
        (("mpcc_apr16_1621_slippery",), ("slippery_apr16_1556/1",), ("slippery_apr16_1556/2",)),
        (("tape_ramp_1758_neg03",), ("tape_ramp_1805_pos03/1",), ("tape_ramp_1805_pos03/2",)),
        (("tape_ramp_1805_pos03",), ("tape_ramp_1758_neg03/1",), ("tape_ramp_1758_neg03/2",)),
        (("ramp_1529",), ("ramp_1605_pos015",), ("ramp_1615_neg02",)),
        (("ramp_1609_neg015",), ("ramp_1534",), ("ramp_1653_neg03",)),
        (("ramp_1653_neg03", "ramp_1605_pos015"), ("ramp_1529",), ("ramp_1609_neg015",)),
        (("ramp_1529",), ("ramp_1534",), ("ramp_1605_pos015",)),
        (("ramp_1615_neg02",), ("ramp_1529",), ("ramp_1605_pos015",)),
        (("ramp_1534", "ramp_1653_neg03"), ("ramp_1609_neg015",), ("ramp_1615_neg02",)),
        (("ramp_1605_pos015",), ("ramp_1653_neg03",), ("ramp_1615_neg02",)),
        (("free_1002",), ("ramp_1534",), ("ramp_1615_neg02",)),
        (("free_1012", "free_1027"), ("ramp_1529",), ("ramp_1605_pos015",)),
        (("ramp_1529", "ramp_1615_neg02"), ("free_1012",), ("free_1027",)),
    ))
}  # fmt: skip
"""Without a change, and none of `CASES`: what a change must gain was chosen on them."""
QUICK = ("slippery", "laps_a_null", "free_a_delay")


def main() -> int:
    """Run the benchmark."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--data", type=Path, default=Path(os.environ.get("GREYBOX_DATA", ".")))
    arguments.add_argument("--out", type=Path, help="folder of results; a temporary one unless given")
    arguments.add_argument("--json", action="store_true", help="one JSON object on standard output")
    arguments.add_argument("--quick", action="store_true", help="one case of each kind")
    arguments.add_argument("--development", action="store_true", help="the pairs on which numbers were chosen instead")
    arguments.add_argument("--cases", nargs="+", choices=sorted({**CASES, **DEVELOPMENT}), metavar="NAME")
    given = arguments.parse_args()
    names = given.cases or (QUICK if given.quick else tuple(DEVELOPMENT if given.development else CASES))
    with tempfile.TemporaryDirectory() as folder:
        out = given.out or Path(folder)
        out.mkdir(parents=True, exist_ok=True)
        rows = []
        for name in names:
            file = out / f"{name}.json"
            if not file.is_file():
                write_atomically(file, json.dumps(row(name, given.data / "dart", out), indent=1) + "\n")
            rows.append(json.loads(file.read_text("utf-8")))
            if not given.json:
                show(rows[-1:])
    if given.json:
        sys.stdout.write(json.dumps({"rows": rows, "bars": bars(rows)}, indent=1) + "\n")
    else:
        show(rows)
        Console().print(bars(rows))
    return 0


def row(name: str, data: Path, out: Path) -> dict[str, Any]:
    """What the command says of a case, and what that is worth."""
    case = {**CASES, **DEVELOPMENT}[name]
    about: dict[str, Any] = {"case": name, "kind": case.kind, "truth": case.truth}
    files = {one.partition("/")[0] for one in (*case.before, *case.after, *case.held_out, *case.like)}
    if lacking := sorted(one for one in files if not (data / f"{one}.csv.gz").is_file()):
        return about | {"error": f"{data} holds no {', '.join(lacking)}"}
    with tempfile.TemporaryDirectory() as folder:
        own = [written(one, case.injected, data, out, Path(folder)) for one in case.after]
        others = [written(one, case.injected, data, out, Path(folder)) for one in case.held_out]
        before = [written(one, "", data, out, Path(folder)) for one in case.before]
        command = [sys.executable, "-c", "from greybox_id.cli import main; main()", "gap", *own, "--since", *before]
        command += ["--vehicle", "dart", "--json", *(word for one in others for word in ("--held-out", one))]
        start = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        end = resource.getrusage(resource.RUSAGE_CHILDREN)
    about["cpu_seconds"] = end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime
    if done.returncode != 0:
        said = done.stderr.strip().splitlines()
        return about | {"error": said[-1] if said else "no answer", "verdict": "error"}
    body = json.loads(done.stdout)
    first = body["ranking"][0] if body["ranking"] else None
    applied = body["applied"]
    found = about | {
        "first": first["effect"] if first else None,
        "magnitude": first["magnitude"] if first else None,
        "sd": (first["interval"][1] - first["interval"][0]) / (2 * 1.96) if first else None,
        "gain": first["gain"] if first else None,
        "probability": first["probability"] if first else None,
        "applied": applied,
        "since": body["scatter"],
        "verdict": "silent" if not applied else "right" if applied == [case.truth] else "wrong",
    }
    if case.like:
        after = saturated([*case.after, *case.held_out], data, out)
        found["saturated"] = after / saturated(list(case.like), data, out)
    return found


def recording(name: str, data: Path, out: Path) -> Recording:
    """A recording, or half of one; converted once, for reading poses takes seconds."""
    whole, _, half = name.partition("/")
    file = out / "converted" / f"{whole}.csv"
    if not file.is_file():
        file.parent.mkdir(exist_ok=True)
        own = read(data / f"{whole}.csv.gz", "dart")
        write_recording(replace(own, signals={n: own[n] for n in SIGNALS}), file)
    own = read(file, "canonical")
    middle = len(own) // 2
    return own if not half else own.rows(0, middle) if half == "1" else own.rows(middle, len(own))


def written(name: str, injected: str, data: Path, out: Path, place: Path) -> str:
    """The path of a recording as the command reads it."""
    own = recording(name, data, out)
    own = altered(own, *INJECTED[injected]) if injected else own
    file = place / f"{name.replace('/', '_')}.csv"
    write_recording(own, file)
    return str(file)


def saturated(names: list[str], data: Path, out: Path) -> float:
    """Lateral acceleration at the tyres' limit, m/s^2: median over recordings."""
    found = [np.nanpercentile(np.abs(recording(name, data, out)["a_y"]), SATURATED) for name in names]
    return float(np.median(found))


def bars(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """How many cases of each kind are as they should be."""
    changed = [own for own in rows if own["kind"] == "changed" and "verdict" in own]
    unchanged = [own for own in rows if own["kind"] == "unchanged" and "verdict" in own]
    injected = [own for own in rows if own["kind"] == "injected" and "verdict" in own]
    told = [abs(own["magnitude"] - own["saturated"]) for own in changed if own.get("saturated") and own.get("applied")]
    return {
        "changed": len(changed),
        "first_right": sum(own.get("first") == own["truth"] and bool(own.get("applied")) for own in changed),
        "magnitude_off": told,
        "unchanged": len(unchanged),
        "unchanged_named": sum(bool(own.get("applied")) for own in unchanged),
        "injected": {verdict: sum(own["verdict"] == verdict for own in injected)
                     for verdict in ("right", "silent", "wrong", "error")},
        "cpu_seconds": float(np.median([own["cpu_seconds"] for own in rows if "cpu_seconds" in own] or [0.0])),
    }  # fmt: skip


def show(rows: list[dict[str, Any]]) -> None:
    """Print rows for people."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    for head in ("case", "first", "magnitude ± sd", "gain", "applied", "verdict", "CPU s"):
        table.add_column(head)
    for own in rows:
        if "error" in own:
            table.add_row(own["case"], own["error"])
            continue
        size = f"{own['magnitude']:.3g} ± {own['sd']:.2g}" if own["first"] else ""
        gain = f"{own['gain']:.1f}" if own["first"] else ""
        applied = ", ".join(own["applied"]) or "nothing"
        table.add_row(own["case"], str(own["first"]), size, gain, applied, own["verdict"], f"{own['cpu_seconds']:.0f}")
    Console().print(table)


if __name__ == "__main__":
    sys.exit(main())
