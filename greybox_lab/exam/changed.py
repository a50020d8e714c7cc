"""Tier changed: recordings of a 1:10 car whose changes are known (DART, Lyons et al.), as cases of what changed since.

changed: taped tyres, on a throttle ramp and drifting, and a slippery floor: grip must be first. The loss is measured by
saturated lateral acceleration, its 95th percentile relative to that before; for ramps, at similar steering.

unchanged: recordings of the same condition, some of them months apart: nothing may be named.

injected: the steering command advanced by 80 ms, reduced by 20 mrad or increased by a ninth, and the yaw rate times
1.05, exactly and in both recordings from after; five pairs each.

two at once: two of these faults on the same pairs, or one beside the grip that was lost. Some combinations develop the
search, others examine it.

On the slippery floor the pose differs as well: below 1.5 m/s^2 the direction of v_y is turned by 16 to 25 mrad against
all other recordings, by its regression on v_x and yaw rate. Naming effects of that is neither right nor wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from math import nan
from pathlib import Path

import numpy as np

from greybox_id.base.errors import BadInput, near
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.how import Say

from .altering import INJECTIONS, altered
from .answers import Answer, Kind
from .make import Exam, make_cases
from .real import ChangedCase, lacking, shuffled

FAULTS = {
    "delay": ("steering_delay", 0.08), "offset": ("steering_offset", 0.02), "ratio": ("steering_ratio", 0.9),
    "yaw_rate": ("yaw_rate_scale", 1.05),
}  # fmt: skip
SATURATED = 95.0
"""Percentile of |a_y| that counts as saturated."""
SIGNALS = ("v_x", "v_y", "yaw_rate", "a_x", "a_y", "steer", "throttle")


@dataclass(frozen=True)
class KnownChange:
    """Recordings before and after, by name; "/1" and "/2" are halves.

    Attributes
    ----------
    before, after, held_out : recordings.
    grip : whether grip was lost; otherwise nothing changed.
    like : recordings from before with similar driving, for comparison of saturated lateral acceleration.
    faults : of `FAULTS`, injected into all recordings from after.
    pose : whether the measured pose differs, too.
    """

    before: tuple[str, ...]
    after: str
    held_out: str = ""
    grip: bool = False
    like: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    pose: bool = False

    @property
    def recordings(self) -> frozenset[str]:
        """All recordings that are compared."""
        return frozenset((*self.before, self.after, *((self.held_out,) if self.held_out else ())))


RAMPS = ("ramp_1529", "ramp_1534", "ramp_1653_neg03")
LAPS = ("mpcc_apr04_1523", "mpcc_apr08_1801")
PAIRS = {
    "free_a": KnownChange(("free_1002",), "free_1012", "free_1027"),
    "free_b": KnownChange(("free_1027",), "free_1002", "free_1012"),
    "free_c": KnownChange(("free_1012",), "free_1002", "free_1027"),
    "laps_a": KnownChange(LAPS[:1], "mpcc_apr08_1801/1", "mpcc_apr08_1801/2"),
    "laps_b": KnownChange(LAPS[1:], "mpcc_apr04_1523/1", "mpcc_apr04_1523/2"),
}
GRIP = {
    "slippery": KnownChange(LAPS, "mpcc_apr16_1621_slippery", "slippery_apr16_1556", True, LAPS, pose=True),
    "tape_ramp": KnownChange(RAMPS, "tape_ramp_1805_pos03", "tape_ramp_1758_neg03", True, RAMPS[2:]),
    "tape_drift": KnownChange(("free_1002", "free_1027", "ramp_1653_neg03"), "tape_drift_1813", "", True),
}
POSE = ("velocity_lever_arm", "steering_offset")
"""Effects of a pose that is measured at another place or in another direction."""


def _with(faults: Mapping[tuple[str, ...], Mapping[str, KnownChange]]) -> dict[str, KnownChange]:
    """Known changes with further faults, by name."""
    return {"_".join((name, *some)): replace(item, faults=some)
            for some, items in faults.items() for name, item in items.items()}  # fmt: skip


CASES: Mapping[str, KnownChange] = {
    **GRIP,
    "ramps_a": KnownChange(RAMPS[:2], "ramp_1605_pos015", "ramp_1609_neg015"),
    "ramps_b": KnownChange(("ramp_1605_pos015", "ramp_1609_neg015"), "ramp_1615_neg02", "ramp_1653_neg03"),
    "free_two": KnownChange(("free_1002", "free_1012"), "free_1027"),
    **{f"{name}_null": item for name, item in PAIRS.items()},
    **_with({(fault,): PAIRS for fault in FAULTS}),
}
TWO = _with({("delay", "yaw_rate"): PAIRS, ("offset", "ratio"): PAIRS, ("yaw_rate",): GRIP})
TWO_DEVELOPMENT = _with({
    ("delay", "offset"): PAIRS, ("ratio", "yaw_rate"): PAIRS, ("delay", "ratio"): PAIRS,
    ("offset", "yaw_rate"): PAIRS, ("delay",): GRIP, ("offset",): GRIP,
})  # fmt: skip
DEVELOPMENT: Mapping[str, KnownChange] = {
    f"development_{k}": KnownChange(before, after, held_out) for k, (before, after, held_out) in enumerate((
        (("free_1002",), "free_1027/1", "free_1027/2"),
        (("free_1012",), "free_1002/1", "free_1002/2"),
        (("free_1027",), "free_1012/1", "free_1012/2"),
        (("free_1002",), "free_1012", ""),
        (("slippery_apr16_1556",), "mpcc_apr16_1621_slippery/1", "mpcc_apr16_1621_slippery/2"),
        (("mpcc_apr16_1621_slippery",), "slippery_apr16_1556/1", "slippery_apr16_1556/2"),
        (("tape_ramp_1758_neg03",), "tape_ramp_1805_pos03/1", "tape_ramp_1805_pos03/2"),
        (("tape_ramp_1805_pos03",), "tape_ramp_1758_neg03/1", "tape_ramp_1758_neg03/2"),
        (("ramp_1529",), "ramp_1605_pos015", "ramp_1615_neg02"),
        (("ramp_1609_neg015",), "ramp_1534", "ramp_1653_neg03"),
        (("ramp_1653_neg03", "ramp_1605_pos015"), "ramp_1529", "ramp_1609_neg015"),
        (("ramp_1529",), "ramp_1534", "ramp_1605_pos015"),
        (("ramp_1615_neg02",), "ramp_1529", "ramp_1605_pos015"),
        (("ramp_1534", "ramp_1653_neg03"), "ramp_1609_neg015", "ramp_1615_neg02"),
        (("ramp_1605_pos015",), "ramp_1653_neg03", "ramp_1615_neg02"),
        (("free_1002",), "ramp_1534", "ramp_1615_neg02"),
        (("free_1012", "free_1027"), "ramp_1529", "ramp_1605_pos015"),
        (("ramp_1529", "ramp_1615_neg02"), "free_1012", "free_1027"),
    ))
}  # fmt: skip
"""Cases without a change, and none of `CASES`, on which the least gain of a change was chosen. They use the same
recordings, since there are no others."""
EVERY = {**CASES, **TWO, **DEVELOPMENT, **TWO_DEVELOPMENT}
SETS: Mapping[str, tuple[str, ...]] = {
    "examination": (*CASES, *TWO), "development": (*DEVELOPMENT, *TWO_DEVELOPMENT), "two": tuple(TWO),
    "two-development": tuple(TWO_DEVELOPMENT),
}  # fmt: skip


def make_changed(folder: Path, data: Path, seed: int, target: Sequence[str], jobs: int, say: Say) -> Exam:
    """Cases of a car whose changes are known.

    Parameters
    ----------
    folder : new, empty, or unfinished from the same request.
    data : folder with a folder dart of recordings.
    seed : of the order of cases; nothing else is random.
    target : cases, or sets of them; by default the set "examination".
    jobs : number of parallel processes.
    say : called with progress.

    Raises
    ------
    BadInput : if a recording is missing, or the folder contains something else.
    """
    names = tuple(dict.fromkeys(name for item in target or ("examination",) for name in SETS.get(item, (item,))))
    for name in names:
        if name not in EVERY:
            raise BadInput(f'There is no case "{name}" of known changes.{near(name, [*EVERY, *SETS])}')
    parts = [part for name in names for part in (*EVERY[name].recordings, *EVERY[name].like)]
    files = [f"dart/{part.partition('/')[0]}.csv.gz" for part in parts]
    if missing := lacking(data, files):
        raise BadInput(f"{data} holds no {', '.join(missing)}. Name the folder of the recordings with ‹data›.")

    @cache
    def recording(name: str) -> Recording:
        whole, _, half = name.partition("/")
        if half:
            value = recording(whole)
            middle = len(value) // 2
            return value.rows(0, middle) if half == "1" else value.rows(middle, len(value))
        value = read(data / "dart" / f"{whole}.csv.gz", "dart")
        return replace(value, signals={signal: value[signal] for signal in SIGNALS})

    def written(case: str, name: str) -> Answer:
        return _case(case, name, recording).written(folder)

    cases = {case: partial(written, case, name) for case, name in zip(shuffled(len(names), seed), names, strict=True)}
    requested = {"tier": "changed", "seed": seed, "cases": list(names), "data": str(data)}
    return make_cases(folder, requested, dict(sorted(cases.items())), jobs, say)


def _case(case: str, name: str, recording: Callable[[str], Recording]) -> ChangedCase:
    """A known change as a case."""
    change = EVERY[name]
    before, after = (
        [recording(one) for one in part if one] for part in (change.before, (change.after, change.held_out))
    )
    effects, nulls = dict[str, float](), dict[str, float]()
    if change.grip:
        lost = nan if not change.like else _saturated(after) / _saturated([recording(one) for one in change.like])
        effects, nulls = {"grip_scale": lost}, {"grip_scale": 1.0}
    for effect, size in (FAULTS[fault] for fault in change.faults):
        after = [altered(one, effect, size) for one in after]
        effects[effect], nulls[effect] = size, INJECTIONS[effect].null
    kind: Kind = "double" if len(effects) > 1 else "changed" if change.grip else "single" if effects else "null"
    nature = POSE if change.pose else ()
    answer = Answer(case, kind, "changed", effects, nulls=nulls, about={"what": name}, nature=nature)
    return ChangedCase("dart", "", before, after, answer)


def _saturated(recordings: Sequence[Recording]) -> float:
    """Lateral acceleration at the tyres' limit, m/s^2: median over recordings."""
    return float(np.median([np.nanpercentile(np.abs(recording["a_y"]), SATURATED) for recording in recordings]))
