"""What a recording leaves open is found and said in words."""

import numpy as np
import pytest

from greybox_id.base.numbers import signed
from greybox_id.fitting.uncertainty.identifiability import Identifiability, identifiability

NAMES = ("mass", "stiffness", "offset", "length")
X = np.array([1000.0, 8e4, 0.001, 2.5])


def covariance(relative_sd, **correlations):
    """Of the four parameters, from standard deviations relative to 1000, 8e4, 1 and 2.5, and correlations (_01=0.9)."""
    sd = np.array(relative_sd) * np.array([1000.0, 8e4, 1.0, 2.5])
    C = np.eye(len(sd))
    for pair, value in correlations.items():
        i, j = (int(digit) for digit in pair.strip("_"))
        C[i, j] = C[j, i] = value
    return C * np.outer(sd, sd)


def test_where_everything_is_told_that_is_said():
    found = identifiability(NAMES, X, covariance([0.1, 0.1, 1e-4, 0.2]))
    assert found.undetermined == found.pairs == found.directions == ()


def test_a_parameter_known_to_less_than_half_its_size_is_not_determined():
    found = identifiability(NAMES, X, covariance([0.1, 0.6, 1e-4, 0.2]))
    assert found.undetermined == ("stiffness",)


def test_a_parameter_that_moved_little_from_its_prior_is_not_determined():
    prior = np.array([150.0, np.inf, np.inf, np.inf])
    found = identifiability(NAMES, X, covariance([0.12, 0.1, 1e-4, 0.2]), prior_sd=prior)
    assert found.undetermined == ("mass",)


def test_an_offset_about_zero_is_measured_against_its_prior():
    C = covariance([0.1, 0.1, 0.002, 0.2])
    alone = identifiability(NAMES, X, C)
    believed = identifiability(NAMES, X, C, prior_sd=np.array([np.inf, np.inf, 0.02, np.inf]))
    assert alone.undetermined == ("offset",)
    assert believed.undetermined == ()
    assert believed.directions == ()


def test_what_nothing_tells_comes_first():
    C = covariance([0.1, 0.6, 1e-4, 0.2])
    C[3, 3] = np.inf
    found = identifiability(NAMES, X, C)
    assert found.undetermined == ("length", "stiffness")


def test_what_is_held_is_left_out():
    C = covariance([0.1, 0.1, 0.0, 0.0])
    found = identifiability(NAMES, np.array([1000.0, 8e4, 0.0, 2.5]), C)
    assert found.undetermined == ()


def test_of_nothing_free_nothing_is_said():
    assert identifiability(NAMES, X, np.zeros((4, 4))) == Identifiability((), (), ())


@pytest.mark.parametrize(("correlation", "word"), [(0.97, "difference"), (-0.97, "sum")])
def test_parameters_that_stand_for_each_other_are_named_in_pairs(correlation, word):
    found = identifiability(NAMES, X, covariance([0.1, 0.1, 1e-4, 0.1], _01=correlation, _23=0.94))
    assert [(pair.first, pair.second) for pair in found.pairs] == [("mass", "stiffness")]
    assert found.pairs[0].about() == (
        f"mass and stiffness are identifiable only in combination, as a weighted {word} "
        f"(correlation {signed(correlation)})."
    )


def test_a_direction_that_is_open_reads_as_parameters_moving_together():
    found = identifiability(NAMES, X, covariance([0.5, 0.4, 1e-4, 0.01], _01=0.999))
    (direction,) = found.directions
    assert direction.names == ("mass", "stiffness")
    np.testing.assert_allclose(direction.moves, [0.5, 0.4], rtol=0.01)
    assert direction.about() == (
        "These changes together (one standard deviation) hardly alter the residuals: mass by +50 % and stiffness by "
        "+40 %."
    )


def test_a_parameter_that_is_open_alone_is_a_direction_of_its_own():
    (direction,) = identifiability(NAMES, X, covariance([0.9, 0.1, 1e-4, 0.1])).directions
    assert direction.about() == "This change (one standard deviation) hardly alters the residuals: mass by +90 %."


def test_where_an_estimate_is_about_zero_changes_are_told_in_its_unit_and_not_in_per_cent_of_it():
    """A curve's shape is a departure from a given one, with a prior about zero; a mass has a size of its own."""
    prior, x = np.array([np.inf, 0.5, np.inf, 0.2]), np.array([1000.0, 0.003, 0.02, -0.01])
    C = np.diag(np.array([500.0, 0.2, 1e-4, 0.18]) ** 2)
    C[0, 1] = C[1, 0] = 0.99 * 500.0 * 0.2
    first, second = identifiability(
        ("mass", "curve", "offset", "tilt"), x, C, prior, ("kg", "1", "rad", "rad")
    ).directions
    assert first.about() == ("This change (one standard deviation) hardly alters the residuals: tilt by +0.18 rad.")
    assert second.about() == (
        "These changes together (one standard deviation) hardly alter the residuals: mass by +50 % and curve by +0.20."
    )
