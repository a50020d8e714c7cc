"""Manoeuvres driven with the synthetic SimRod: what it records, and the truth beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...recording import Recording
from ..virtual_vehicle import Forms, steered
from .car import EFFECTS, FORMS, simrod
from .manoeuvres import MANOEUVRES, Manoeuvre, Part, steering
from .truth import TyreTruth, tyre_truth

RATE = 100.0
"""Rows a second."""


@dataclass(frozen=True)
class Test:
    """One manoeuvre as it was driven.

    Attributes
    ----------
    manoeuvre : what was asked for.
    recording : time, v_x, v_y, yaw_rate, a_x, a_y, steer and ax_cmd: all that an estimator may read.
    truth : the tyres' forces and slips; only for the score.
    """

    __test__ = False  # no test of pytest's

    manoeuvre: Manoeuvre
    recording: Recording
    truth: TyreTruth


def make(seed: int = 0, part: Part | None = None, noise: float = 1.0) -> tuple[Test, ...]:
    """All manoeuvres, or those of one part, each a recording of its own.

    Parameters
    ----------
    seed : of the sensors' noise; manoeuvres are always the same.
    part : "train" or "held out"; None for both.
    noise : sd of the sensors over that of the vehicle file.
    """
    chosen = [k for k, manoeuvre in enumerate(MANOEUVRES) if part in (None, manoeuvre.part)]
    seeds = [int(np.random.SeedSequence((seed, k)).generate_state(1)[0]) for k in chosen]
    return drive([MANOEUVRES[k] for k in chosen], seeds, noise=noise)


def drive(
    manoeuvres: Sequence[Manoeuvre],
    seeds: Sequence[int],
    *,
    noise: float = 1.0,
    effects: Mapping[str, float] = EFFECTS,
    forms: str | Forms = FORMS,
) -> tuple[Test, ...]:
    """Drive manoeuvres.

    Parameters
    ----------
    manoeuvres : what to steer, and how fast to drive.
    seeds : of the noise of each.
    noise : sd of the sensors over that of the vehicle file.
    effects, forms : of the virtual vehicle; {"tyre_relaxation": 0.3} for example makes tyres lag behind.
    """
    car, found = simrod(), []
    for manoeuvre, seed in zip(manoeuvres, seeds, strict=True):
        steer = steering(manoeuvre, RATE)
        speed = np.full(len(steer), manoeuvre.speed)
        recording, truth = steered(car, manoeuvre.name, steer, speed, RATE, effects, forms, seed, noise=noise)
        found.append(Test(manoeuvre, recording, tyre_truth(truth, recording.time)))
    return tuple(found)
