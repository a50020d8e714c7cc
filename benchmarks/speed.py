"""How fast: ten rows, each a ratio of two things done in turn in one run, so that other machines and busy ones compare.

    python benchmarks/speed.py [--json] [--repeats 3] [--history FILE]

CPU seconds but where wall time is said; medians of ratios over repeats. --history adds a line of JSON to a file, and
the table then shows the last one beside. A report, not a test: nothing fails here.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from engine import NOISE, condensed, ipopt_alone, problem, scipy_compiled, simulator
from running import options, tell
from threadpoolctl import threadpool_limits

import greybox_id as gb
from greybox_id.engine.motion.shooting import MotionProblem

LONG, SHORT = 17_200, 2_400
"""Samples of the two problems of `benchmarks/engine.py`."""
UNIT = 400
"""Size of the matrices whose product, done ten times, is the unit of what has no rival to be compared with."""


def main() -> None:
    """Run the benchmark."""
    given = options(__doc__, repeats=3, history={"type": Path, "help": "file to which a line is added"})
    with threadpool_limits(1):
        rows = [measured(*row, given.repeats) for row in compared()]
    before = last(given.history)
    body = {"time": datetime.now(UTC).isoformat(timespec="seconds"), "version": gb.__version__, "rows": rows}
    if given.history:
        with given.history.open("a", encoding="utf-8") as opened:
            opened.write(json.dumps(body) + "\n")
    if not given.json:
        body["rows"] = [row | {"last time": before.get(row["what"])} for row in rows]
    tell(body, given.json)


def last(history: Path | None) -> dict[str, float]:
    """Ratios of the last line of a history, by what they are of."""
    if history is None or not history.exists():
        return {}
    lines = history.read_text(encoding="utf-8").splitlines()
    return {row["what"]: row["ratio"] for row in json.loads(lines[-1])["rows"]} if lines else {}


def measured(
    what: str, over: str, ours: Callable[[], float], other: Callable[[], float], repeats: int
) -> dict[str, Any]:
    """Both in turn, after a first time that is not counted: it compiles and fills caches."""
    ours()
    pairs = [(ours(), other()) for _ in range(repeats)]
    return {
        "what": what,
        "over": over,
        "seconds": float(np.median([own for own, _ in pairs])),
        "ratio": float(np.median([theirs / own for own, theirs in pairs])),
    }


def compared() -> list[tuple[str, str, Callable[[], float], Callable[[], float]]]:
    """What is measured, what it is compared with, and what each takes, s; a ratio above 1 is how much faster."""
    found = []
    for samples in (SHORT, LONG):
        model, recording = problem(samples)

        def ours(m: Any = model, r: Any = recording) -> float:
            return condensed(m, r).solve_seconds

        found.append((f"fit of {samples} samples", "Ipopt alone, Gauss-Newton", ours,
                      lambda m=model, r=recording: ipopt_alone(m, r, 20).solve_seconds))  # fmt: skip
    found.append((f"the same fit of {LONG}", "scipy, same kernel", ours,
                  lambda: scipy_compiled(model, recording).solve_seconds))  # fmt: skip
    stated = MotionProblem(simulator(model), [recording], noise=NOISE)
    nodes = stated.simulated_nodes(stated.start)

    def fused() -> float:
        return cpu(lambda: stated.normal_equations(stated.start, nodes))

    def laid_out() -> float:
        return cpu(lambda: [J.reshape(-1, J.shape[-1]).T @ J.reshape(-1, J.shape[-1])
                            for _, J in stated.residuals(stated.start, nodes)])  # fmt: skip

    found.append(("normal equations, fused", "Jacobian laid out", fused, laid_out))
    found.append(
        ("normal equations", "one simulation", fused, lambda: cpu(lambda: stated.simulated_nodes(stated.start)))
    )
    found.append(("two threads, wall time", "one thread", partial(threaded, fused, "2"), partial(threaded, fused, "1")))
    lap = gb.datasets.shipped("racer_train")
    check = ["-c", "from greybox_id.cli import main; main()", "data", "check", str(lap), "--columns", "roboracer"]
    pandas = ["-c", "import pandas"]
    found.append(("greybox data check, shipped lap", "import pandas", lambda: process(check), lambda: process(pandas)))
    found.append(("greybox --help", "python -c pass", lambda: process([*check[:2], "--help"]),
                  lambda: process(["-c", "pass"])))  # fmt: skip
    train = gb.read(lap, columns="roboracer")
    for name in ("msnn_lat", "msnn_full"):
        found.append((f"fit of {name}, shipped lap", "ten products of matrices",
                      lambda name=name: cpu(lambda: gb.fit(name, train)), unit))  # fmt: skip
    return found


def cpu(work: Callable[[], object]) -> float:
    """CPU seconds that some work takes here."""
    began = time.process_time()
    work()
    return time.process_time() - began


def unit() -> float:
    """CPU seconds of ten products of matrices."""
    own = np.random.default_rng(0).standard_normal((UNIT, UNIT))
    return cpu(lambda: [own @ own for _ in range(10)])


def threaded(work: Callable[[], object], count: str) -> float:
    """Wall seconds of some work in so many threads."""
    before, began = os.environ.get("GREYBOX_THREADS"), time.perf_counter()
    os.environ["GREYBOX_THREADS"] = count
    work()
    took = time.perf_counter() - began
    os.environ.pop("GREYBOX_THREADS")
    if before is not None:
        os.environ["GREYBOX_THREADS"] = before
    return took


def process(arguments: list[str]) -> float:
    """CPU seconds of another Python process."""
    before = os.times()
    subprocess.run([sys.executable, *arguments], capture_output=True, check=True)
    after = os.times()
    return after.children_user - before.children_user + after.children_system - before.children_system


if __name__ == "__main__":
    main()
