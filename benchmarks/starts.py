"""How often a fit finds the optimum from a random start, with and without growing horizons.

    python benchmarks/starts.py [--json] [--starts 60] [--sd 0.7]

The problem is that of benchmarks/engine.py at 2 400 samples. Every free parameter is multiplied by a log-normal factor
of the given standard deviation. A start counts as successful when it ends within 1e-6 of the least objective of all.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from engine import DT, FREE, NOISE, problem, simulator
from running import options, tell
from threadpoolctl import threadpool_limits

from greybox_id.base.shorthands import Array
from greybox_id.engine.motion.shooting import MotionProblem
from greybox_id.engine.solvers.gauss_newton import gauss_newton
from greybox_id.fitting.attempt import SHORT_HORIZONS, SHORT_STEPS
from greybox_id.models.single_track import lateral

CHAINS: dict[str, tuple[int | None, ...]] = {
    "growing horizons: " + ", ".join(f"{rows} rows" for rows in SHORT_HORIZONS) + ", whole run": (
        *SHORT_HORIZONS,
        None,
    ),
    "whole run at once": (None,),
}
SAME = 1e-6


def main() -> None:
    """Run the benchmark."""
    given = options(__doc__, starts=60, sd={"type": float, "default": 0.7, "help": "of the factors' logarithm"})
    with threadpool_limits(1):
        tell({"rows": compare(given.starts, given.sd)}, given.json)


def compare(starts: int, sd: float) -> list[dict[str, Any]]:
    """Every way from the same starts."""
    model, recording = problem(2400)
    low, high = (np.array([p.bounds[side] for p in model.parameters]) for side in (0, 1))
    place = [[p.name for p in model.parameters].index(name) for name in FREE]
    ends: dict[str, list[tuple[float, int]]] = {}
    for way, chain in CHAINS.items():
        random = np.random.default_rng(1)
        problems = [
            MotionProblem(
                simulator(model), [recording], noise=NOISE,
                horizon=None if rows is None else rows * DT, starts="free" if rows is None else "measured",
            )
            for rows in chain
        ]  # fmt: skip
        ends[way] = []
        for _ in range(starts):
            p = lateral().values
            p[place] *= np.exp(sd * random.standard_normal(len(place)))
            ends[way].append(_led(problems, np.clip(p, low, high)))
    least = min(objective for found in ends.values() for objective, _ in found)
    return [
        {
            "way": way,
            "starts": starts,
            "found": sum(objective <= least * (1 + SAME) for objective, _ in found),
            "steps": float(np.median([steps for _, steps in found])),
        }
        for way, found in ends.items()
    ]


def _led(problems: list[MotionProblem], p: Array) -> tuple[float, int]:
    """Where a start leads: the objective over the whole run, and steps taken."""
    steps = 0
    for stated in problems:
        whole = stated.horizon is None
        solution = gauss_newton(
            stated, stated.unknowns(p), search="levenberg_marquardt", max_steps=100 if whole else SHORT_STEPS,
            tolerance=1e-10 if whole else 1e-3, negligible=0.0 if whole else 1e-3,
        )  # fmt: skip
        p, steps = stated.shared(solution.x), steps + solution.steps
    return solution.objective, steps


if __name__ == "__main__":
    main()
