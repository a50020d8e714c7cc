"""A designed manoeuvre: what is driven, the expected motion, and the expected information."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from ...base.json_data import Kind
from ...base.shorthands import Array
from .arena import NOWHERE, Arena, Placement
from .course import AT, PlannedMotion
from .driver import PlanDriver
from .limits import DriveLimits
from .primitives import Phase

KIND = Kind("greybox-design", 1, "a designed manoeuvre", "greybox design", "design again")
CORRIDOR = ("x", "y", "v_x", "yaw_rate")
"""Signals whose 95 % corridor a plan gives."""
TURNING = {"turn": "turn", "spiral": "tighten slowly", "steps": "step steer", "sine": "sine steer", "sweep": "sweep",
           "sine with dwell": "sine with dwell", "lane change": "lane change", "straight": "hold"}  # fmt: skip
ALONG = 0.05
"""Share of the grip below which a phase is called straight."""


@dataclass(frozen=True)
class Separation:
    """Expected separation of two explanations.

    Attributes
    ----------
    pair : names.
    nats : log-likelihood that the wrong one is expected to lose; its 10 % quantile over what is uncertain is `p10`.
    """

    pair: tuple[str, str]
    nats: float
    p10: float


@dataclass(frozen=True)
class Design:
    """A manoeuvre, and what it is expected to show.

    Attributes
    ----------
    goal : "precision", "discriminate" or "detect".
    model : name of the model it was designed with.
    arena, limits : within which it is driven.
    drive : signal of the drive command.
    criterion : its name, and values before and after in nats.
    phases : of the chain; empty where nothing is left to be shown, or no manoeuvre shows it.
    plan : commands and expected motion, with the start as origin; None where there are no phases.
    corridor : (2, n, outputs) 2.5 % and 97.5 % quantiles of the expected motions.
    placement, driver : in the arena, and who drives it.
    predicted_sd : name -> standard deviation before and after.
    separation : of pairs of explanations.
    active_limits : limits that the manoeuvre reaches.
    impossible : sentences on what no manoeuvre shows.
    kept : share of the draws of what is uncertain that keep to all limits.
    repeat : how often it is to be driven.
    said : sentences that come first.
    """

    goal: str
    model: str
    arena: Arena
    limits: DriveLimits
    drive: str
    criterion: Mapping[str, Any]
    phases: tuple[Phase, ...] = ()
    plan: PlannedMotion | None = None
    corridor: Array = field(default_factory=lambda: np.empty((2, 0, 0)))
    placement: Placement = NOWHERE
    driver: PlanDriver | None = None
    predicted_sd: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    separation: tuple[Separation, ...] = ()
    active_limits: tuple[str, ...] = ()
    impossible: tuple[str, ...] = ()
    kept: float = 1.0
    repeat: int = 1
    said: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """Duration of one drive, s."""
        return 0.0 if self.plan is None else float(self.plan.time[-1] + self.plan.time[1] - self.plan.time[0])

    @property
    def run_up(self) -> float:
        """Straight before the first row, m, in which the first speed is reached."""
        if self.plan is None:
            return 0.0
        return float(self.plan.of("v_x")[0] ** 2 / self.limits.drive_max)

    def table(self) -> pd.DataFrame:
        """The plan row by row: commands, expected motion in the arena's axes, its 95 % corridor; SI units.

        Columns `time`, `phase`, `steer`, the drive signal, `v_x`, `yaw_rate`, `a_y`, `x`, `y`, `yaw`, and `<name>_low`,
        `<name>_high` of x, y, v_x and yaw_rate.
        """
        assert self.plan is not None
        plan = self.plan
        x, y = self.placement.placed(plan.of("x"), plan.of("y"))
        columns: dict[str, Any] = {
            "time": plan.time, "phase": plan.phase + 1, "steer": plan.steer, self.drive: plan.drive,
            **{name: plan.of(name) for name in ("v_x", "yaw_rate", "a_y")},
            "x": x, "y": y, "yaw": plan.of("yaw") + self.placement.yaw,
            **{f"{name}_{end}": self._edge(name, k) for name in CORRIDOR for k, end in enumerate(("low", "high"))},
        }  # fmt: skip
        return pd.DataFrame(columns).round(6)

    def _edge(self, name: str, k: int) -> Array:
        if name not in ("x", "y"):
            return np.asarray(self.corridor[k][:, AT[name]])
        here, across = (self.corridor[j][:, [AT["x"], AT["y"]]] for j in (k, 1 - k))
        c, s = np.cos(self.placement.yaw), np.sin(self.placement.yaw)
        row = np.array([c, -s]) if name == "x" else np.array([s, c])
        base = self.placement.x if name == "x" else self.placement.y
        return np.asarray(base + np.where(row > 0, here, across) @ row)

    @property
    def sentence(self) -> str:
        """The instruction for a driver."""
        if self.plan is None:
            return ""
        plan, v, parts = self.plan, self.plan.of("v_x"), []
        for k, phase in enumerate(self.phases):
            rows = np.flatnonzero(plan.phase == k)
            if len(rows) < 2:
                continue
            a, b = rows[0], rows[-1]
            lasts = float(plan.time[b] - plan.time[a])
            steering = _steering(phase, plan.steer[a : b + 1], lasts)
            parts.append(f"{steering}{_speed(float(v[a]), float(v[b]))} for {lasts:.1f} s")
        parts.append(f"brake straight ahead to {v[-1]:.1f} m/s")
        return f"From {v[0]:.1f} m/s straight ahead: {'; '.join(parts)}."

    def as_dict(self) -> dict[str, Any]:
        """The design as plain data."""
        start = None
        if self.plan is not None:
            start = {
                "x": self.placement.x, "y": self.placement.y, "yaw": self.placement.yaw,
                "v_x": float(self.plan.of("v_x")[0]), "run_up": self.run_up,
            }  # fmt: skip
        return {
            "goal": self.goal,
            "model": {"name": self.model},
            "criterion": dict(self.criterion),
            "predicted_sd": {name: list(item) for name, item in self.predicted_sd.items()},
            "separation": [{"pair": list(o.pair), "nats": o.nats, "p10": o.p10} for o in self.separation],
            "active_limits": list(self.active_limits),
            "impossible": list(self.impossible),
            "said": list(self.said),
            "sentence": self.sentence,
            "arena": self.arena.words,
            "duration": self.duration,
            "repeat": self.repeat,
            "limits": asdict(self.limits),
            "kept": self.kept,
            "phases": [asdict(phase) for phase in self.phases],
            "driver": None if self.driver is None else asdict(self.driver),
            "start": start,
        }

    def text(self) -> str:
        """The text of design.json."""
        return KIND.text(self.as_dict())


def _steering(phase: Phase, steer: Array, lasts: float) -> str:
    most = float(np.max(np.abs(steer)))
    if abs(phase.amplitude) + abs(phase.lean) < ALONG or (phase.shape == "straight" and abs(phase.lean) < ALONG):
        return "straight ahead"
    middle = float(np.median(steer))
    if phase.shape == "straight" or abs(phase.amplitude) < ALONG:
        return f"hold a {_side(middle)}-hand circle, {abs(middle):.3f} rad"
    words = TURNING[phase.shape]
    if phase.shape in ("turn", "spiral"):
        words += f" {_side(float(steer[int(np.argmax(np.abs(steer)))]))}"
    words += f", up to {most:.3f} rad"
    if phase.shape in ("steps", "sine", "sweep"):
        cycles = max(round(phase.frequency * lasts), 1)
        words += f", {cycles} period{'s' if cycles > 1 else ''}"
    if abs(phase.lean) >= ALONG and phase.shape not in ("turn", "spiral"):
        words += f", on a {_side(phase.lean)}-hand circle"
    return words


def _side(value: float) -> str:
    return "left" if value > 0 else "right"


def _speed(a: float, b: float) -> str:
    if abs(b - a) < 0.06 * max(a, b):
        return f" at {0.5 * (a + b):.1f} m/s"
    return f", {'faster' if b > a else 'slower'} to {b:.1f} m/s,"
