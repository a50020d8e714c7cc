"""Stated values: those that a recording contradicts, and estimates that scale with one (a mass is in every force)."""

from dataclasses import replace

import pytest
from driven import driven

from greybox_id.fitting.fit import NOT_USABLE, USABLE
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.verb import fit
from greybox_id.models.parameter import Prior
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

QUICK = FitOptions(horizon=1.0, start_from="measured")
OFF = 1.09


def model(**tolerances):
    """The full-size car's with a mass that is stated 9 % too high."""
    found = build("lateral", None, {}, vehicle("full_size_car"))
    heavy = found.with_parameters(found["m"].with_value(OFF * found["m"].array))
    free = ("I_z", "B_f", "D_f", *tolerances)
    priors = {name: Prior(sd=sd, mean=heavy[name].array) for name, sd in tolerances.items()}
    return heavy.with_parameters(
        *(replace(p, fixed=p.name not in free, prior=priors.get(p.name)) for p in heavy.parameters)
    )


def test_what_scales_with_a_stated_mass_is_said_to_and_what_is_per_mass_holds_the_truth():
    laps = [driven("lateral", runs=1, seconds=20.0, seed=seed, noise=0.1) for seed in (0, 3)]
    found = fit(model(), laps[:1], validate=laps[1], how=QUICK)
    assert found.how["scaling"] == {"m": ["I_z", "C_alpha_f", "C_alpha_r"]}
    assert found.verdict.usability == USABLE
    assert found.verdict.reasons[-1].startswith(
        "The recordings do not determine m. I_z, C_alpha_f and C_alpha_r are proportional"
    )
    assert found.notes()["I_z"] == "proportional to m: valid only for the stated m"
    known = {one.name: one for one in found.combined()}
    assert "proportional to m: valid only for the stated m" in known["C_alpha_f"].about
    true = {p.name: float(p.array) for p in build("lateral", None, {}, vehicle("full_size_car")).parameters}
    assert known["I_z / m"].low < true["I_z"] / true["m"] < known["I_z / m"].high
    assert float(found.model["I_z"].array) == pytest.approx(OFF * true["I_z"], rel=0.03)


def test_a_tolerance_is_in_the_intervals_and_nothing_more_is_said():
    found = fit(model(m=150.0), [driven("lateral", runs=1, seconds=20.0, noise=0.1)], how=QUICK)
    assert found.how["scaling"] == {}
    fact = fit(model(), [driven("lateral", runs=1, seconds=20.0, noise=0.1)], how=QUICK)
    assert found.sd["I_z"] > 3 * fact.sd["I_z"]  # 9 % of the mass are 9 % of the inertia


def test_what_is_in_no_proportion_to_a_stated_value_is_not_said_to_be():
    found = fit(model(), [driven("lateral", runs=1, seconds=20.0, noise=0.1)], how=QUICK)
    assert not {"B_f", "D_f"} & {*found.how["scaling"]["m"]}
    assert not {"l_f", "l_r"} & {*found.how["scaling"]}


def test_a_mass_that_lateral_motion_told_scales_with_the_inertia_that_is_stated():
    known = build("lateral", None, {}, vehicle("full_size_car"))
    known = known.with_parameters(*(replace(p, fixed=p.name != "m", prior=None) for p in known.parameters))
    found = fit(known, [driven("lateral", runs=1, seconds=20.0, noise=0.1)], how=QUICK)
    assert found.how["scaling"] == {"I_z": ["m", "C_alpha_f", "C_alpha_r"]}


def test_a_right_mass_is_not_contradicted_by_an_inertia_within_its_tolerance():
    found = model(I_z=400.0)
    right = found.with_parameters(found["m"].with_value(found["m"].array / OFF), found["I_z"].with_value(2900.0))
    right = right.with_parameters(replace(right["I_z"], prior=Prior(sd=400.0, mean=2900.0)))
    assert fit(right, [driven("lateral", runs=1, seconds=40.0, noise=0.1)], how=QUICK).how["contradicted"] == {}


@pytest.mark.parametrize(("length", "inertia", "wrong"), [(1.0, None, ""), (1.15, None, "wheelbase"), (1.0, 30.0, "m")])
def test_a_fact_that_the_recording_contradicts_is_named_with_its_size(length, inertia, wrong):
    """A wheelbase; and a mass beside a tolerance: lateral motion tells I_z / m."""
    found = model(**({"I_z": inertia} if inertia else {}))
    true = build("lateral", None, {}, vehicle("full_size_car"))
    changed = [found[name].with_value(length * found[name].array) for name in ("l_f", "l_r")]
    changed += [found["I_z"].with_value(true["I_z"].array)]
    found = fit(found.with_parameters(*changed), [driven("lateral", runs=1, seconds=40.0, noise=0.1)], how=QUICK)
    assert {*found.how["contradicted"]} == ({wrong} if wrong else set())
    for change, _ in found.how["contradicted"].values():
        assert change == pytest.approx(1 / (length if wrong == "wheelbase" else OFF) - 1, abs=0.03)
    said = [reason for reason in found.verdict.reasons if "contradicts the stated" in reason]
    assert [wrong in reason for reason in said] == ([True] if wrong else [])


def test_a_wheelbase_that_is_far_off_is_of_another_vehicle():
    found = model()
    long = found.with_parameters(*(found[name].with_value(1.4 * found[name].array) for name in ("l_f", "l_r")))
    found = fit(long, [driven("lateral", runs=1, seconds=40.0, noise=0.1)], how=QUICK)
    assert found.verdict.usability == NOT_USABLE
    assert any("contradicts the stated wheelbase" in reason for reason in found.verdict.reasons)
