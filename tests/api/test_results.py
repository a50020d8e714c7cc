"""Results by name, as tables, figures and linear systems; they agree with the records that they are."""

import control
import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest

import greybox_id as gb
from greybox_id.fitting.fit import Fit
from greybox_id.fitting.scores.metrics import score, simulate

mpl.use("Agg")


@pytest.fixture(scope="module")
def laps():
    lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer")
    return lap.rows(0, 500), lap.rows(900, 1300)


@pytest.fixture(scope="module")
def fit(laps):
    lap, other = laps
    fast = gb.FitOptions(solver="gauss-newton")
    return gb.fit(
        "lateral", lap, vehicle="roboracer", validation=other, fix=["m"], effects=["steering_lag"], options=fast
    )


def test_a_fit_is_the_record_that_it_was(fit, tmp_path):
    assert isinstance(fit, Fit)
    again = gb.load(fit.save(tmp_path / "fit.json"))
    assert again.params.equals(fit.params)
    assert again.as_dict() == fit.as_dict()
    assert again.stderr.equals(fit.stderr)


def test_numbers_stand_by_name(fit):
    free = [p.name for p in fit.model.parameters if not p.fixed]
    assert fit.params.index.tolist() == [p.name for p in fit.model.parameters]
    assert fit.params["m"] == fit.model["m"].value
    assert fit.stderr[free].notna().all()
    assert fit.stderr.drop(free).isna().all()
    assert fit.cov.index.tolist() == fit.cov.columns.tolist() == free
    assert np.sqrt(np.diag(fit.cov)) == pytest.approx(fit.stderr[free].to_numpy(), rel=1e-6)
    assert np.diag(fit.corr) == pytest.approx(1.0)
    assert fit.corr.abs().to_numpy().max() <= 1 + 1e-9


def test_intervals_are_the_records_at_95_percent_and_grow_with_the_level(fit):
    at = fit.conf_int(0.95)
    for p in fit.model.parameters:
        assert at.loc[p.name].tolist() == pytest.approx([float(end) for end in fit.interval(p.name)], nan_ok=True)
    width = fit.conf_int(0.5), fit.conf_int(0.9), fit.conf_int(0.99)
    free = fit.cov.index
    spans = [(own.upper - own.lower)[free] for own in width]
    assert (spans[0] < spans[1]).all()
    assert (spans[1] <= spans[2]).all()


def test_intervals_are_students(fit):
    from scipy.stats import t

    low, high = fit.conf_int(0.8).loc["I_z"]
    half = t.ppf(0.9, float(fit.dof["I_z"])) * fit.stderr["I_z"]
    assert (low, high) == pytest.approx((fit.params["I_z"] - half, fit.params["I_z"] + half))


def test_entries_of_arrays_have_names():
    model = gb.models.msnn_lat()
    fit = gb.Fit(model, {p.name: np.zeros(p.shape) for p in model.parameters}, (), {}, (), "given", 0)
    assert len(fit.params) == model.size
    place = ",".join("1" * model["F"].array.ndim)
    assert fit.params[f"F[{place}]"] == model["F"].array[(1,) * model["F"].array.ndim]
    with pytest.raises(gb.BadInput, match="keeps no covariance"):
        fit.cov  # noqa: B018


def test_a_score_is_a_tidy_table_of_what_the_command_says(fit, laps):
    table, known = fit.score(laps[1]), score(fit.model, laps[1])
    for row in table.itertuples():
        error = known[row.protocol][row.output]
        assert (row.rmse, row.stderr, row.fvu) == (error.rmse, error.rmse_sd, error.fvu)
    assert set(table["horizon"]) == {0.1, 0.5, 1.0, 2.0, np.inf}
    assert set(table["unit"]) == {"rad/s", "m/s^2"}


def test_the_fit_percentage_is_that_of_system_identification(fit, laps):
    lap, free_run = laps[1], fit.simulate(laps[1])
    y, predicted = lap["yaw_rate"], free_run["yaw_rate"]
    there = np.isfinite(predicted)
    wanted = 100 * (1 - np.linalg.norm((y - predicted)[there]) / np.linalg.norm((y - y[there].mean())[there]))
    own = fit.score(lap).query("output == 'yaw_rate' and protocol == 'free run'")["fit_percent"].item()
    assert own == pytest.approx(wanted)


def test_simulations_lie_on_the_recordings_rows(fit, laps):
    lap = laps[1]
    found, rows = fit.simulate(lap), simulate(fit.model, lap)
    assert np.array_equal(found.time, lap.time)
    assert found.runs == lap.runs
    assert np.array_equal(found["yaw_rate"][rows.rows], rows.predicted[:, fit.model.outputs.index("yaw_rate")])
    table = found.to_pandas()
    assert isinstance(table, pd.DataFrame)
    assert table.attrs["units"]["a_y"] == "m/s^2"


def test_residuals_are_measured_less_predicted(fit, laps):
    lap = laps[1]
    left, ahead = fit.residuals(lap, 0.5), fit.predict(lap, 0.5)
    assert left["yaw_rate"] == pytest.approx(lap["yaw_rate"] - ahead["yaw_rate"], nan_ok=True)
    assert "v_y" not in left


def test_criteria_are_those_of_the_training_residuals(fit, laps):
    left = fit.resid
    assert left.index.names == ["recording", "time"]
    logs = [-0.5 * len(e) * (np.log(2 * np.pi * np.mean(e**2)) + 1) for e in (left[c].dropna() for c in left)]
    assert fit.llf == pytest.approx(sum(logs), rel=1e-6)
    assert fit.nobs == int(left.notna().sum().sum())
    assert fit.aic == pytest.approx(2 * fit.df_model - 2 * fit.llf)
    assert fit.bic == pytest.approx(np.log(fit.nobs) * fit.df_model - 2 * fit.llf)


def test_fits_of_the_same_data_are_compared(fit, laps):
    held = gb.fit(fit.model, laps[0], free=[], fix=[p.name for p in fit.model.parameters if p.shape == ()][:3])
    table = fit.compare(held)
    assert table["df_model"].tolist() == [fit.df_model, held.df_model]
    assert table["aic"].tolist() == [fit.aic, held.aic]
    assert (table.filter(like="train ").iloc[0] <= 1.01 * table.filter(like="train ").iloc[1]).all()
    with pytest.raises(gb.BadInput, match="other training data"):
        fit.compare(gb.fit(fit.model, laps[1]))


def test_a_profile_is_that_of_the_problem_that_was_fitted(fit):
    found = fit.profile("I_z", confidence=0.9)
    assert found.interval[0] < fit.params["I_z"] < found.interval[1]
    assert "values" not in repr(found)


def test_a_linear_system_has_the_step_response_of_the_model(fit):
    sys = fit.linearise(v_x=2.0)
    assert isinstance(sys, control.StateSpace)
    assert sys.state_labels == ["v_y", "yaw_rate", "steer"] or len(sys.state_labels) == 3
    assert sys.input_labels == ["steer", "v_x"]
    assert sys.output_labels == list(fit.model.outputs)
    assert np.all(np.real(sys.poles()) < 0)
    time = np.arange(0.0, 3.0, 0.01)
    size = 1e-4
    steps = gb.Recording("step", time, {"steer": np.full(len(time), size), "v_x": np.full(len(time), 2.0),
                                        "v_y": np.zeros(len(time)), "yaw_rate": np.zeros(len(time))})  # fmt: skip
    simulated = gb.simulate(fit.model, steps, start={"v_y": 0.0, "yaw_rate": 0.0})["yaw_rate"]
    response = control.forced_response(sys, time, np.vstack([np.full(len(time), size), np.zeros(len(time))]))
    assert simulated[-1] == pytest.approx(response.outputs[1][-1], rel=1e-3)


def test_a_linear_system_about_a_turn_is_the_models_derivative(laps):
    model = gb.models.single_track(vehicle="roboracer")
    fit = gb.Fit(model, {}, (), {}, (), "given", 0)
    straight, turn = fit.linearise(3.0), fit.linearise(3.0, steer=0.1)
    assert straight.state_labels == ["v_x", "v_y", "yaw_rate"]
    assert straight.A[0, 1:] == pytest.approx(0.0, abs=1e-9)  # straight on, sideways motion does not brake
    assert abs(turn.A[0, 2]) > 1e-3


def test_what_a_linear_system_lacks_is_said():
    model = gb.models.lateral(vehicle="roboracer") + gb.effects.steering_delay.at(0.05)
    fit = gb.Fit(model, {}, (), {}, (), "given", 0)
    with pytest.warns(UserWarning, match=r"delay of steer, 0.05 s"):
        fit.linearise(3.0)
    with pytest.raises(gb.BadInput, match="v_x: a speed above zero"):
        fit.linearise(-3.0)


def test_figures_are_axes(fit, laps):
    assert [ax.get_ylabel() for ax in fit.plot(laps[0])] == [
        ax.get_ylabel() for ax in fit.plot.measured_and_simulated(laps[0])
    ]
    axes = fit.plot.measured_and_simulated(laps[1])
    assert [ax.get_ylabel() for ax in axes] == ["yaw_rate [rad/s]", "a_y [m/s²]"]
    assert np.nanmax(axes[0].lines[0].get_ydata()) == np.nanmax(laps[1]["yaw_rate"])
    assert len(fit.plot.residuals()) == 2
    tyres = fit.plot.tyres()
    assert [line.get_label() for line in tyres.lines] == ["front axle", "rear axle"]
    assert fit.plot.handling().get_xlabel().startswith("lateral acceleration")
    own = mpl.figure.Figure().add_subplot()
    assert fit.plot.parameters("I_z", "B_f", ax=own) is own
    assert len(own.get_yticklabels()) == 2
    with pytest.raises(gb.BadInput, match="Did you mean I_z"):
        fit.plot.parameters("I_zz")


def test_a_figure_that_a_model_has_not_is_said(laps):
    fit = gb.Fit(gb.models.kinematic(), {}, (), {}, (), "given", 0)
    with pytest.raises(gb.BadInput, match="no tyres"):
        fit.plot.tyres()


def test_runs_whose_clock_begins_anew_are_laid_one_behind_the_other(fit):
    other = gb.read(gb.datasets.shipped("racer_valid"), columns="roboracer")
    (first, *_) = fit.plot.measured_and_simulated(other)
    ends = [(line.get_xdata()[0], line.get_xdata()[-1]) for line in first.lines[::2]]
    assert all(a[1] < b[0] for a, b in zip(ends[:-1], ends[1:], strict=True))


def test_a_summary_says_what_was_fitted(fit):
    text = fit.summary()
    for name in ("I_z", "steering_lag"):
        assert f"\n{name} " in text
    assert "held out racer_train" in text
    assert max(map(len, text.splitlines())) < 160


def test_results_are_shown_in_a_few_lines(fit, laps):
    track = gb.track(fit, laps[1], options=gb.TrackOptions(tune=0.0))
    for own in (fit, laps[0], fit.model, track, gb.Vehicle.load("roboracer")):
        assert len(repr(own).splitlines()) <= 10
        assert len(repr(own)) < 1000
        assert own._repr_html_().startswith("<")
    table = track.to_pandas()
    assert len(table) == len(track.rows)
    assert {"C_alpha_f", "C_alpha_f_sd"} <= set(table)
    assert track.plot("C_alpha_f").get_ylabel() == "C_alpha_f [N/rad]"
    assert len(track.plot()) == len(track.values)


def test_units_are_shown_as_they_are_printed(laps):
    for own in (laps[0], gb.effects.accel_bias_x, gb.models.lateral(vehicle="roboracer")["I_z"]):
        assert "^" not in repr(own)
    assert repr(gb.models.Parameter("I_z", "kg m^2", 0.05, (0.005, 0.5), about="yaw inertia")) == (
        "Parameter I_z [kg m²]: 0.05, bounds [0.005, 0.5]; yaw inertia"
    )
    array = gb.models.Parameter("c", "1", [[1.0, 2.0]], prior=gb.models.Prior(1.0), fixed=True, scope="run")
    assert repr(array) == "Parameter c: array of shape (1, 2) from 1 to 2, fixed, with a prior, one for each run"


def test_networks_are_shown_in_a_few_lines():
    model = gb.models.msnn_full()
    fit = gb.Fit(model, {p.name: np.zeros(p.shape) for p in model.parameters}, (), {}, (), "given", 0)
    assert len(repr(fit).splitlines()) <= 10
    assert len(repr(model).splitlines()) <= 10


def test_a_diagnosis_hands_on_its_closed_model(laps, tmp_path):
    lap, other = laps
    tried = ["steering_delay", "steering_lag", "steering_ratio"]
    gap = gb.diagnose("kinematic", lap, held_out=other, vehicle="roboracer", effects=tried)
    assert len(repr(gap).splitlines()) <= 10
    assert gap._repr_html_().startswith("<")
    assert set(gap.to_pandas()["effect"]) <= {*tried, "timestamp_jitter", "held_samples"}
    assert gap.closed_model.effects == gap.applied
    assert len(gap.plot().get_yticklabels()) == len(gap.ranking)
    assert gb.report([gap], tmp_path / "gap.html").stat().st_size > 10_000
    assert (tmp_path / "car" / "car.c") in gb.export(gap.closed_model, tmp_path / "car")


def test_fits_and_gaps_stand_in_one_report(fit, laps, tmp_path):
    text = gb.report([fit, fit], tmp_path / "two.html").read_text(encoding="utf-8")
    assert "1 lateral" in text
    assert "2 lateral" in text


def test_what_changed_cannot_be_asked_of_the_same_data(laps):
    lap, other = laps
    with pytest.raises(gb.BadInput, match="is named as a recording from before"):
        gb.diagnose("lateral", lap, since=lap, vehicle="roboracer")
    with pytest.raises(gb.BadInput, match="is named as a recording from before"):
        gb.diagnose("lateral", lap, since=other, held_out=other, vehicle="roboracer")


@pytest.mark.slow
def test_what_changed_is_told_with_what_did_not(laps):
    lap, other = laps
    found = gb.diagnose("lateral", lap, since=other, vehicle="roboracer")
    assert isinstance(found, gb.Gap)
    assert found.since == (other.name,)
    assert set(found.changed["effect"]) == set(found.applied)
    assert {*found.changed["effect"], *found.not_changed["effect"], *found.not_seen} == set(found.scatter)
    assert found.closed_model.name == "lateral"
    assert len(repr(found).splitlines()) <= 10
    assert found._repr_html_().startswith("<")
    assert found.summary().startswith("changed")
