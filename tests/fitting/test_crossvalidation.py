"""Blocked cross-validation: what is held out, what is left, what is chosen."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toys import DT, drive, joined, linear_toy, obeying_toy

from greybox_id.base.errors import GreyboxError
from greybox_id.engine.shooting import Problem
from greybox_id.engine.trace import Trace
from greybox_id.fitting.crossvalidation import TOLERANCE, blocks, choose_strengths, choose_structure, cross_validated
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.verb import fit
from greybox_id.models.parameter import Prior

many = given(
    st.lists(st.integers(12, 150), min_size=1, max_size=4), st.integers(2, 8), st.integers(1, 6), st.booleans()
)


def problem_of(lengths, memory, symmetric):
    return Problem(Trace(linear_toy(memory, symmetric=symmetric)), [joined(*lengths)], noise=np.array([0.1]))


@many
@settings(max_examples=25)
def test_every_predicted_row_is_held_out_exactly_once(lengths, folds, memory, symmetric):
    problem = problem_of([*lengths, 12 * 6 * memory], memory, symmetric)
    times = sum(np.concatenate(held[: problem.copies]) for _, held in blocks(problem, folds))
    predicted = np.concatenate([np.arange(len(run)) >= run.first for run in problem.runs[: problem.copies]])
    assert np.all(times[predicted] == 1)


@many
@settings(max_examples=25)
def test_no_row_that_is_kept_shares_a_sample_with_one_held_out(lengths, folds, memory, symmetric):
    problem = problem_of(lengths, memory, symmetric)
    for kept, held in blocks(problem, folds):
        for k in range(len(problem.runs)):
            for row in np.flatnonzero(held[k % problem.copies]):
                near = kept[k][max(0, row - memory) : row + memory + 1]
                assert not np.any(near)


@many
@settings(max_examples=25)
def test_the_mirror_image_of_a_held_out_stretch_is_left_out_too(lengths, folds, memory, symmetric):
    problem = problem_of(lengths, memory, symmetric)
    for kept, _ in blocks(problem, folds):
        for k in range(problem.copies, len(problem.runs)):
            assert np.array_equal(kept[k], kept[k - problem.copies])


@pytest.mark.parametrize(
    ("F", "sd", "rows", "noise", "factor"),
    [
        (np.array([0.1, 0.5, 1.0]), 0.002, 400, 0.01, 0.5),  # the prior is far from what the data say
        (np.zeros(12), 5.0, 200, 5.0, 4.0),  # there is nothing but noise to fit
        (np.array([0.1, 0.5, 1.0]), 1.0, 400, 0.1, 1.0),  # it makes no difference
    ],
)
def test_a_strength_moves_from_as_stated_only_where_held_out_stretches_ask_for_it(F, sd, rows, noise, factor):
    trace = Trace(linear_toy(len(F), Prior(sd, mean=0.0, strength="s")))
    choice = choose_strengths(trace, [obeying_toy(F, rows, noise=noise)], np.array([noise]), np.zeros(len(F)))
    assert choice.strengths["s"] == factor


def test_other_strengths_are_told_from_where_folds_ended_and_exactly_where_the_model_is_linear():
    F, noise = np.array([0.1, 0.5, 1.0]), np.array([0.1])
    problem = Problem(Trace(linear_toy(3, Prior(0.05, mean=0.0, strength="s"))), [obeying_toy(F, 400)], noise=noise)
    stated, strong = (cross_validated(problem.counted(strengths={"s": s}), np.zeros(3)) for s in (1.0, 4.0))
    assert np.max(np.abs(strong.squares / stated.squares - 1)) > 0.05
    np.testing.assert_allclose(stated.nearby({"s": 4.0}), strong.squares, rtol=TOLERANCE)  # where folds end


def test_every_strength_tried_is_on_record_with_its_error():
    model = linear_toy(3, Prior(1.0, strength="s"))
    choice = choose_strengths(Trace(model), [obeying_toy(np.ones(3), noise=0.1)], np.array([0.1]), np.zeros(3))
    assert len(choice.tried) >= 4
    assert choice.error == {s["s"]: e for s, e in choice.tried}[choice.strengths["s"]]
    assert choice.error == pytest.approx(1.0, rel=0.2)  # of the noise


@pytest.mark.parametrize("rows", [5, 8, 12, 20, 40])
def test_a_recording_too_short_to_hold_anything_out_is_fitted_or_refused_in_a_sentence(rows):
    model = replace(linear_toy(4, Prior(1.0, strength="s")), sample_time=DT)
    with suppress(GreyboxError):
        assert np.isfinite(fit(model, [drive(rows)], how=FitOptions(solver="gauss-newton")).stages[0].history[-1])


def test_the_structure_that_generated_the_data_is_chosen_among_others():
    models = [replace(linear_toy(length), name=f"toy {length}") for length in (1, 3, 40)]
    recording = obeying_toy(np.array([1.0, -1.0, 1.0]), 300, noise=0.2)
    assert choose_structure(models, [recording])[0] == 1


def test_structures_of_the_same_name_are_told_apart():
    recording = obeying_toy(np.array([1.0, -1.0, 1.0]), 300, noise=0.1)
    assert choose_structure([linear_toy(1), linear_toy(3)], [recording])[0] == 1
