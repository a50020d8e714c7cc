"""What holds of every tyre model, and what is published of each."""

from types import SimpleNamespace

import casadi as cs
import numpy as np
import pytest
import reference_vehicle

from greybox_id.base.errors import BadInput
from greybox_id.models.tyres import TYRES, TyreSettings, axle

CAR, RACER = 3600.0, 17.0  # axle loads, N
LIMITED = [name for name in TYRES if name != "linear"]


def parameters(name, F_z, slope_per_load=13.0, mu=0.9):
    """A tyre of the class: C_alpha = 13 F_z per rad."""
    if name == "pacejka":
        return SimpleNamespace(B=slope_per_load / 1.4 / mu, C=1.4, D=mu, E=0.3, S_h=0.0, S_v=0.0)
    return SimpleNamespace(C_alpha=slope_per_load * F_z, mu=mu)


def curve(name, p):
    """(alpha, F_z, grip, stiffness) -> F_y and its derivatives by all four."""
    names = [cs.SX.sym(own) for own in ("alpha", "F_z", "grip", "stiffness")]
    F_y = cs.SX(TYRES[name].force(names[0], names[1], p, names[2], names[3]))
    function = cs.Function("tyre", names, [F_y, cs.densify(cs.jacobian(F_y, cs.vertcat(*names)))])

    def evaluate(alpha, F_z=CAR, grip=1.0, stiffness=1.0):
        alphas = np.atleast_1d(alpha)
        F, J = function.map(len(alphas))(alphas[np.newaxis], F_z, grip, stiffness)
        return np.array(F).ravel(), np.array(J).reshape(len(alphas), 4)

    return evaluate


@pytest.mark.parametrize("F_z", [CAR, RACER])
@pytest.mark.parametrize("name", TYRES)
def test_the_slope_at_zero_slip_is_the_one_stated(name, F_z):
    p = parameters(name, F_z)
    stated = TYRES[name].slope(F_z, p)
    assert stated == pytest.approx(13.0 * F_z)
    tyre = curve(name, p)
    assert tyre(0.0, F_z)[1][0, 0] == pytest.approx(stated, rel=1e-12)
    assert tyre(1e-7, F_z)[0][0] / 1e-7 == pytest.approx(stated, rel=1e-5)


@pytest.mark.parametrize(("name", "reached"), [("pacejka", 1 - 1e-4), ("brush", 1.0), ("dugoff", 0.99)])
def test_the_peak_is_never_exceeded_and_is_reached(name, reached):
    p = parameters(name, CAR)
    F_y, _ = curve(name, p)(np.linspace(-3, 3, 6001))
    share = np.abs(F_y) / TYRES[name].peak(CAR, p, 1.0)
    assert share.max() <= 1 + 1e-12
    assert share.max() >= reached


@pytest.mark.parametrize("C", [0.5, 0.8, 1.0, 1.3])
@pytest.mark.parametrize("E", [-2.0, 0.0, 0.5])
def test_pacejkas_peak_is_what_the_curve_comes_to(C, E):
    p = SimpleNamespace(**{**vars(parameters("pacejka", CAR)), "C": C, "E": E})
    slip = np.concatenate([np.linspace(0.0, 3.0, 30_001), [1e9]])
    F_y = [float(TYRES["pacejka"].force(alpha, CAR, p, 1.0, 1.0)) for alpha in slip[[*range(0, 30_001, 10), -1]]]
    assert max(F_y) == pytest.approx(float(TYRES["pacejka"].peak(CAR, p, 1.0)), rel=1e-5)


@pytest.mark.parametrize("grip", [0.0, 1e-3, 1.0])
@pytest.mark.parametrize("F_z", [0.0, 1e-9, 1.0, CAR])
@pytest.mark.parametrize("name", TYRES)
def test_derivatives_are_finite_everywhere(name, F_z, grip):
    steep = [
        0.0,
        1e-300,
        1e-12,
        0.5 * 0.9 / 13,
        np.arctan(0.5 * 0.9 / 13),
        np.arctan(3 * 0.9 / 13),
        1.5,
        np.pi / 2,
        3.1,
    ]
    alpha = np.array([*steep, *np.negative(steep)])
    F_y, J = curve(name, parameters(name, CAR))(alpha, F_z, grip)
    assert np.all(np.isfinite(F_y))
    assert np.all(np.isfinite(J))


@pytest.mark.parametrize("name", LIMITED)
def test_the_slope_is_continuous_on_the_way_to_the_limit(name):
    """No kink where Dugoff leaves the straight line, nor where the brush slides."""
    alpha = np.linspace(-1.4, 1.4, 20001)
    slope = curve(name, parameters(name, CAR))(alpha)[1][:, 0]
    assert np.max(np.abs(np.diff(slope))) < 0.01 * 13 * CAR


@pytest.mark.parametrize("name", TYRES)
def test_stiffness_scales_the_slope_and_leaves_the_peak(name):
    p = parameters(name, CAR)
    tyre = curve(name, p)
    assert tyre(0.0, stiffness=1.3)[1][0, 0] == pytest.approx(1.3 * tyre(0.0)[1][0, 0])
    if name in LIMITED:
        alpha = np.linspace(0, 1.5, 20001)
        assert tyre(alpha, stiffness=1.3)[0].max() == pytest.approx(tyre(alpha)[0].max(), rel=0.01)


@pytest.mark.parametrize("name", LIMITED)
def test_grip_scales_the_peak(name):
    p = parameters(name, CAR)
    alpha = np.linspace(0, 1.5, 20001)
    tyre = curve(name, p)
    assert TYRES[name].peak(CAR, p, 0.7) == pytest.approx(0.7 * TYRES[name].peak(CAR, p, 1.0))
    assert tyre(alpha, grip=0.7)[0].max() == pytest.approx(0.7 * tyre(alpha)[0].max(), rel=0.01)


@pytest.mark.parametrize("name", ["brush", "dugoff"])
def test_less_friction_leaves_the_carcass_as_stiff_as_it_is(name):
    tyre = curve(name, parameters(name, CAR))
    assert tyre(0.0, grip=0.3)[1][0, 0] == pytest.approx(13.0 * CAR)


def test_a_linear_tyre_has_no_peak():
    p = parameters("linear", CAR)
    assert TYRES["linear"].peak(CAR, p, 1.0) == np.inf
    assert curve("linear", p)(0.5, grip=0.1)[0][0] == pytest.approx(0.5 * 13.0 * CAR)


def test_pacejkas_curve_is_shifted_by_S_h_and_S_v():
    p = parameters("pacejka", CAR)
    shifted = SimpleNamespace(**{**vars(p), "S_h": 0.01, "S_v": 0.02})
    moved = curve("pacejka", shifted)(np.array([-0.01, 0.04]))[0]
    assert np.allclose(moved, curve("pacejka", p)(np.array([0.0, 0.05]))[0] + 0.02 * CAR)


@pytest.mark.parametrize("name", TYRES)
def test_tyres_are_those_of_the_reference_vehicle(name):
    p = parameters(name, CAR)
    B, C, E = (p.B, p.C, p.E) if name == "pacejka" else (13.0 / 1.4 / 0.9, 1.4, 0.0)
    alpha = np.linspace(-2, 2, 401)
    expected = [0.9 * CAR * reference_vehicle.shape(reference_vehicle.TYRES[name], B, C, E, a) for a in alpha]
    assert np.allclose(curve(name, p)(alpha)[0], expected, rtol=1e-9)


@pytest.mark.parametrize("suffix", ["f", "r"])
@pytest.mark.parametrize("name", TYRES)
def test_parameters_carry_the_axle_in_their_name(name, suffix):
    own = TYRES[name].parameters(suffix)
    assert all(parameter.name.endswith(f"_{suffix}") and parameter.about for parameter in own)
    without = axle(SimpleNamespace(**{parameter.name: parameter.value for parameter in own}, m=1.0), suffix)
    assert set(vars(without)) == {parameter.name.removesuffix(f"_{suffix}") for parameter in own}


def test_an_unknown_tyre_is_refused_in_a_sentence():
    with pytest.raises(BadInput, match="Did you mean pacejka"):
        TyreSettings("pacjka")
