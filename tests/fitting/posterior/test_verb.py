"""Draws of posteriors: the normal one where the model is linear, the same however often a run is interrupted."""

from dataclasses import replace

import numpy as np
import pytest
from driven import driven

from greybox_id.base.errors import BadInput
from greybox_id.fitting.holding import restated
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.posterior import verb
from greybox_id.fitting.posterior.density import PosteriorDensity
from greybox_id.fitting.posterior.posterior import identity, load_posterior
from greybox_id.fitting.posterior.predictive import predictive_band
from greybox_id.fitting.posterior.verb import SampleOptions, sample
from greybox_id.fitting.uncertainty import uncertainty
from greybox_id.fitting.verb import fit
from greybox_id.models.parameter import Prior
from greybox_id.models.registry import build

FREE = ("I_z", "C_alpha_f", "C_alpha_r")


def fitted(recording, bounds=None, **how):
    model = build("lateral", {"tyre": "linear"})
    model = model.with_parameters(
        *(replace(p, fixed=p.name not in FREE, prior=Prior(0.2 * abs(float(p.array)) + 0.01)) for p in model.parameters)
    )
    for name, (low, high) in (bounds or {}).items():
        value = np.clip(model[name].array, low, high)
        model = model.with_parameters(replace(model[name], bounds=(low, high), value=value))
    return fit(model, [recording], how=FitOptions(solver="gauss-newton", start_from="measured", **how))


@pytest.fixture(scope="module")
def lap():
    return driven("lateral", runs=2, seconds=4.0)


@pytest.fixture(scope="module")
def found(lap):
    return fitted(lap)


@pytest.fixture(scope="module")
def drawn(found, lap):
    return sample(found, [lap], SampleOptions("mcmc", 800, seed=1))


def test_chains_meet_where_the_fit_is_and_are_as_wide_as_its_covariance(found, lap, drawn):
    assert len(drawn) == 800
    assert drawn.complete
    assert drawn.r_hat.max() < 1.1
    assert drawn.ess.min() > 200
    assert 0.3 < drawn.acceptance < 0.9
    assert drawn.evaluations > 800
    problem, solution = restated(found, [lap])
    index = problem.parameters.index[0]
    scatter = uncertainty(problem, solution.x, solution.nodes).sd[index]
    names = [parameter.name for parameter in found.model.parameters]
    for name in FREE:
        own, sd, stated = drawn.table.loc[name], float(scatter[names.index(name)]), float(found.sd[name])
        assert sd <= stated
        assert own["mean"] == pytest.approx(float(found.model[name].array), abs=0.5 * stated)
        assert own["sd"] == pytest.approx(stated, rel=0.15)
        assert own["sd_noise_alone"] == pytest.approx(sd, rel=0.4)
        assert own["low"] < own["low_noise_alone"] < own["mean"] < own["high_noise_alone"] < own["high"]


def test_draws_have_the_covariance_that_the_fit_states(found, lap):
    own = sample(found, [lap], SampleOptions("laplace", 4000))
    names = [parameter.name for parameter in found.model.parameters]
    places = [names.index(name) for name in FREE]
    stated = found.covariance[np.ix_(places, places)]
    unit = np.sqrt(np.diag(stated))
    np.testing.assert_allclose(own.covariance() / np.outer(unit, unit), stated / np.outer(unit, unit), atol=0.15)


def test_a_fit_without_an_error_of_form_has_draws_of_the_noise_alone(found, lap, monkeypatch):
    monkeypatch.setattr(verb, "beyond_noise", lambda fit, problem, known: np.zeros((fit.model.size,) * 2))
    own = sample(found, [lap], SampleOptions("laplace", 200))
    np.testing.assert_allclose(own.values, own.noise_alone, rtol=1e-9)


def test_laplace_and_mcmc_draw_from_the_same(found, lap, drawn):
    own = sample(found, [lap], SampleOptions("laplace", 4000))
    assert own.pareto_k < 0.5
    assert own.r_hat.isna().all()
    assert own.ess.min() > 2000
    assert own.cautions() == []
    assert own.as_dict()["pareto_k"] == own.pareto_k
    for name in FREE:
        sd = drawn.table["sd"][name]
        assert own.table["sd"][name] == pytest.approx(sd, rel=0.1)
        assert own.table["mean"][name] == pytest.approx(drawn.table["mean"][name], abs=0.15 * sd)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["laplace", "mcmc"])
def test_at_a_bound_it_is_the_part_within(found, lap, method):
    """The bound half an sd of the noise below the estimate: what lies below it of the draws of the noise alone."""
    free = sample(found, [lap], SampleOptions("laplace", 4000))
    cap = float(found.model["C_alpha_r"].array) - 0.5 * float(free.table["sd_noise_alone"]["C_alpha_r"])
    below = free.noise_alone[:, FREE.index("C_alpha_r")] < cap
    share = free.weight[below] / np.sum(free.weight[below])
    expected = share @ free.noise_alone[below]
    spread = np.sqrt(share @ (free.noise_alone[below] - expected) ** 2)
    low = found.model["C_alpha_r"].bounds[0]
    bounded = fitted(lap, bounds={"C_alpha_r": (low, cap)})
    assert float(bounded.model["C_alpha_r"].array) == pytest.approx(cap)
    own = sample(bounded, [lap], SampleOptions(method, 2000, seed=1))
    for name, middle, sd in zip(FREE, expected, spread, strict=True):
        alone = own.noise_alone[:, FREE.index(name)]
        assert own.weight @ alone == pytest.approx(middle, abs=0.5 * sd)
        assert own.table["sd_noise_alone"][name] == pytest.approx(sd, rel=0.25)
    assert own.table["high"]["C_alpha_r"] <= cap  # with the error of form, too


def test_a_posterior_far_from_normal_is_told(found, lap, tmp_path, monkeypatch):
    """Only on a shell about the fit is there any density: no draws hit it often enough."""

    def shell(self, points):
        far = np.sum(((points - self.centre) / (0.001 * self.centre)) ** 2, axis=1)
        return -((far - 1e4) ** 4)

    monkeypatch.setattr(PosteriorDensity, "__call__", shell)
    own = sample(found, [lap], SampleOptions("laplace", 500))
    again = load_posterior(own.save(tmp_path / "posterior.parquet"))
    assert again.pareto_k == own.pareto_k > 0.63
    assert np.all(again.weight == again.weight[0])
    assert any("Use mcmc" in sentence for sentence in again.cautions())


class Killed(Exception):
    """The process is gone."""


@pytest.mark.slow
@pytest.mark.parametrize("method", ["mcmc", "abc-smc"])
def test_a_killed_run_goes_on_to_the_same_draws(found, lap, tmp_path, monkeypatch, method):
    monkeypatch.setattr(verb, "KEEP_EVERY", 0.0)
    monkeypatch.setattr(verb.abc_smc, "TARGETS", (0.5, 0.2))
    options = SampleOptions(method, 100, seed=4)
    whole = sample(found, [lap], options)
    file, count = tmp_path / "posterior.parquet", 0

    def keep(own):
        nonlocal count
        own.save(file)
        count += 1
        if count % 3 == 0:
            raise Killed

    begun = None
    for _ in range(50):
        try:
            last = sample(found, [lap], options, begun=begun, keep=keep)
            break
        except Killed:
            begun = load_posterior(file)
            assert not begun.complete
    assert count > 3
    assert last.complete
    assert np.array_equal(last.values, whole.values)
    assert np.array_equal(last.weight, whole.weight)


@pytest.mark.slow
def test_ctrl_c_leaves_what_there_is_and_more_draws_go_on(found, lap, monkeypatch):
    blocks = 0

    def stop(line, passing=False):
        nonlocal blocks
        blocks += "block" in line
        if blocks == 24:
            raise KeyboardInterrupt

    cut = sample(found, [lap], SampleOptions("mcmc", 200, seed=2), say=stop)
    assert not cut.complete
    assert any("interrupted" in own for own in cut.cautions())
    short = sample(found, [lap], SampleOptions("mcmc", 200, seed=2), begun=cut)
    longer = sample(found, [lap], SampleOptions("mcmc", 330, seed=2), begun=short)
    whole = sample(found, [lap], SampleOptions("mcmc", 330, seed=2))
    assert np.array_equal(longer.values, whole.values)
    assert np.array_equal(longer.values[:200], short.values)


def test_a_run_of_another_seed_or_fit_is_not_gone_on_with(found, lap, drawn):
    other = sample(found, [lap], SampleOptions("laplace", 50, seed=9), begun=drawn)
    assert len(other) == 50
    assert identity(found) == identity(found)
    assert identity(fitted(driven("lateral", seed=5, seconds=4.0))) != identity(found)


def test_abc_closes_in_on_the_fit(found, lap, monkeypatch):
    monkeypatch.setattr(verb.abc_smc, "TARGETS", (0.5, 0.3, 0.2, 0.1))
    own = sample(found, [lap], SampleOptions("abc-smc", 200, seed=3))
    assert np.sum(own.weight) == pytest.approx(1.0)
    assert own.r_hat.isna().all()
    assert 20 < own.ess.min() <= 200
    prior = 0.2 * float(build("lateral", {"tyre": "linear"})["C_alpha_f"].array)
    assert own.table["sd"]["C_alpha_f"] < 0.5 * prior
    assert own.measured == "distance"
    assert own.measure.max() <= own.state["threshold"]


def test_what_is_saved_is_what_is_loaded(drawn, tmp_path):
    again = load_posterior(drawn.save(tmp_path / "posterior.parquet"))
    assert np.array_equal(again.values, drawn.values)
    assert np.array_equal(again.noise_alone, drawn.noise_alone)
    assert again.table.equals(drawn.table)
    assert again.fit == drawn.fit
    assert again.source == drawn.source
    own = drawn.to_arviz()
    assert set(own["posterior"]) == set(FREE)
    chains = len(np.unique(drawn.chain))
    assert all(values.shape == (chains, 800 // chains) for values in own["posterior"].values())


def test_a_file_of_the_version_before_says_what_it_lacks_and_is_gone_on_with(found, lap, drawn, tmp_path, monkeypatch):
    monkeypatch.setattr("greybox_id.fitting.posterior.posterior.VERSION", 2)
    earlier = replace(drawn, values=drawn.noise_alone).save(tmp_path / "earlier.parquet")
    monkeypatch.undo()
    again = load_posterior(earlier)
    assert not again.with_form
    assert "do not include the error of the equations" in again.cautions()[0]
    whole = sample(found, [lap], SampleOptions("mcmc", 800, seed=1), begun=again)
    assert whole.with_form
    np.testing.assert_allclose(whole.values, drawn.values, rtol=1e-12)


def test_draws_beyond_a_bound_are_put_on_it(found, drawn):
    low, high = np.array([found.model[name].bounds for name in FREE]).T
    assert np.all((drawn.values >= low) & (drawn.values <= high))


def test_a_damaged_file_is_a_sentence(drawn, tmp_path):
    file = drawn.save(tmp_path / "posterior.parquet")
    file.write_bytes(file.read_bytes()[:-200])
    with pytest.raises(BadInput, match="is not a posterior"):
        load_posterior(file)
    with pytest.raises(BadInput, match="is not there"):
        load_posterior(tmp_path / "none.parquet")


@pytest.mark.slow
def test_a_band_holds_the_readings_it_should(found, drawn):
    fresh = driven("lateral", runs=4, seconds=8.0, seed=40)
    band = predictive_band(found, drawn, fresh)
    assert np.all((band.coverage() > 0.9) & (band.coverage() < 0.985))
    narrow = predictive_band(found, drawn, fresh, level=0.5)
    assert np.all((narrow.coverage() > 0.4) & (narrow.coverage() < 0.6))


def test_draws_of_another_fit_predict_nothing(drawn, lap):
    other = fitted(driven("lateral", seed=5, seconds=4.0))
    with pytest.raises(BadInput, match="another fit"):
        predictive_band(other, drawn, lap)


def test_draws_are_priors_of_the_next_fit(drawn):
    mean, sd = drawn.priors()["I_z"]
    assert (mean, sd) == (drawn.table["mean"]["I_z"], drawn.table["sd"]["I_z"])


@pytest.mark.parametrize(
    "options", [{"method": "gibbs"}, {"draws": 3}, {"draws": 2.5}, {"seed": -1}, {"distance": "x"}]
)
def test_what_cannot_be_used_is_a_sentence(options):
    with pytest.raises(BadInput, match=next(iter(options))):
        SampleOptions(**options)


def test_ctrl_c_before_any_draw_leaves_a_place_to_go_on_from(found, lap, tmp_path, capsys):
    def stop(line, passing=False):
        if "block 2 " in line:
            raise KeyboardInterrupt

    cut = sample(found, [lap], SampleOptions("mcmc", 50, seed=6), say=stop)
    assert (len(cut), cut.complete) == (0, False)
    assert np.isnan(cut.as_dict()["parameters"]["I_z"]["mean"])
    assert cut.cautions()
    again = load_posterior(cut.save(tmp_path / "posterior.parquet"))
    assert len(sample(found, [lap], SampleOptions("mcmc", 50, seed=6), begun=again)) == 50
    assert capsys.readouterr().out == ""
