"""Damaged files of every kind end in an answer or a sentence; benchmarks/hostile.py does the same with ten thousand."""

import numpy as np
import pytest
from hostile import MEMORY, run
from hostile_seeds import KINDS


@pytest.mark.slow
def test_damaged_files_break_no_bar():
    found = run(cases=6 * len(KINDS), seed=11)
    assert len(found) == 6 * len(KINDS)
    assert [(own.case, own.kind, own.broken) for own in found if own.broken] == []
    assert {own.code for own in found} >= {0, 2}  # some damage is none, most is told


@pytest.mark.slow
def test_memory_of_whoever_starts_the_harness_is_not_counted():
    held = np.ones(int(1.2 * MEMORY / 8))
    (own,) = run(cases=1, seed=11)
    assert held.nbytes > MEMORY > own.peak
    assert own.broken == ""


@pytest.mark.examination
@pytest.mark.slow
def test_many_damaged_files_break_no_bar():
    found = run(cases=400, seed=12, jobs=2)
    assert [(own.case, own.kind, own.broken) for own in found if own.broken] == []
