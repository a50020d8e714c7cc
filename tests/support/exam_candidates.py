"""Candidates that sit an examination in tests; a worker finds them by "exam_candidates:name"."""

import os
import time
from pathlib import Path


def silent(case: Path):
    """Finds nothing, quickly."""
    assert {"recording.csv", "vehicle.toml"} >= {file.name for file in case.iterdir()}
    print("what a candidate prints is not the run's result")
    (case / "closed.toml").write_text((case / "vehicle.toml").read_text())
    return diagnosis()


def lost(case: Path):
    """Goes wrong in several ways, by the number of the case."""
    number = int(case.name[-1])
    if number == 0:
        raise ValueError("no idea")
    if number == 1:
        os._exit(7)
    if number == 2:
        time.sleep(60)
    return diagnosis(gap_detected=True)


def peeking(case: Path):
    """Looks for the answer, and would not say that it could not."""
    try:
        (case / "../../sealed" / case.name / "answer.json").read_text()
    except Exception:
        return diagnosis()
    return diagnosis()


def swallowing(case: Path):
    """Looks around, and swallows all that is raised."""
    try:
        os.listdir(case.parent.parent / "sealed")
    except BaseException:
        return diagnosis()
    return diagnosis()


def neighbourly(case: Path):
    """Looks at another case."""
    other = "case_001" if case.name == "case_000" else "case_000"
    (case.parent / other / "recording.csv").read_text()
    return diagnosis()


def shelling(case: Path):
    """Has another program look."""
    import subprocess

    subprocess.run(["ls", str(case.parent.parent / "sealed")], check=True)
    return diagnosis()


def diagnosis(**own):
    """A diagnosis that names nothing."""
    return {
        "gap_detected": False, "p_value": 0.5, "unknown_probability": 0.0, "ranking": [], "applied": [],
        "gap": {"closed": 0.0}, **own,
    }  # fmt: skip


def ranked(effect, probability=0.9, magnitude=1.0, interval=(0.9, 1.1)):
    """An effect of a ranking."""
    return {"effect": effect, "probability": probability, "magnitude": magnitude, "interval": list(interval)}
