"""Fits side by side: differences are told where they are there, and only on recordings that all were judged on."""

from dataclasses import replace

import numpy as np
import pytest
from report_parts import tables

from greybox_id.reports.comparison import NamedFit, common_role, comparison, paired
from greybox_id.reports.html import page


def coloured(rng, n, rho=0.9):
    values = np.zeros(n)
    for k in range(1, n):
        values[k] = rho * values[k - 1] + rng.standard_normal()
    return values


def test_intervals_cover_differences_of_correlated_errors():
    """Both models err alike but for what is their own: 95 % intervals of their difference hold zero."""
    rng, held = np.random.default_rng(1), 0
    for _ in range(60):
        common = coloured(rng, 1500)
        own = [common + 0.5 * coloured(rng, 1500) for _ in range(2)]
        found = paired(own[0], own[1], np.repeat([0, 1], 750), 0.05)
        held += not found.significant
    assert held >= 52


def test_pairing_tells_what_apart_would_not_be_told():
    rng = np.random.default_rng(2)
    common = coloured(rng, 3000)
    better, worse = common + 0.1 * coloured(rng, 3000), 1.1 * common + 0.1 * coloured(rng, 3000)
    found = paired(better, worse, np.zeros(3000, dtype=int), 0.05)
    assert found.significant
    assert found.low < found.second - found.first < found.high
    assert found.seconds >= 1.0
    spread = np.std([np.sqrt(np.mean(part**2)) for part in np.array_split(better, found.blocks)]) / found.blocks**0.5
    assert found.high - found.low < 2 * 1.96 * spread  # narrower than the errors of either are known


def test_too_few_blocks_tell_no_interval():
    found = paired(np.ones(30), 2 * np.ones(30), np.zeros(30, dtype=int), 0.05)
    assert np.isnan(found.low)
    assert not found.significant
    assert (found.first, found.second) == (1.0, 2.0)


@pytest.fixture
def two(motion_fit, laps):
    car = motion_fit.model
    worse = replace(motion_fit, model=car.with_parameters(car["B_f"].with_value(0.5 * float(car["B_f"].array))))
    return [NamedFit("right", motion_fit, tuple(laps)), NamedFit("soft", worse, tuple(laps))]


def test_the_worse_of_two_fits_is_called_so(two):
    document = comparison(two)
    ((lead, sentence),) = document.verdict
    assert lead == "soft"
    assert "larger in yaw rate" in sentence
    table = next(own for own in tables(document) if own.head[0] == "output")
    row = next(row for row in table.rows if row[0].startswith("yaw rate"))
    assert float(row[3]) > float(row[2])
    assert page(document) == page(comparison(two))


def test_a_fit_beside_itself_differs_in_nothing(two):
    document = comparison([two[0], replace(two[0], name="again")])
    assert "larger" not in document.verdict[0][1]
    assert "smaller" not in document.verdict[0][1]


def test_fits_judged_on_other_files_are_not_compared(two):
    record = two[1].fit.data[-1]
    moved = replace(two[1].fit, data=(*two[1].fit.data[:-1], replace(record, sha256="0" * 64, name="other")))
    document = comparison([two[0], replace(two[1], fit=moved)])
    assert "were scored on different held-out recordings" in document.verdict[0][1]
    assert common_role([two[0], two[0]]) == "validate"
    trained = replace(two[0], fit=replace(two[0].fit, data=two[0].fit.data[:2]))
    assert common_role([trained, trained]) == "train"
    assert common_role([trained, two[0]]) is None


def test_horizons_are_drawn_in_their_order_and_outputs_that_several_fits_predict(two, small_fit, train, validate):
    (drawing,) = (own for own in comparison(two).drawings if own.name == "comparison")
    assert [tick.get_text() for tick in drawing.figure.first().get_xticklabels()] == ["0.1", "0.5", "1", "2", "free"]
    assert [ax.get_title() for ax in drawing.figure.axes] == ["v_y", "yaw rate", "a_y"]
    maps = [NamedFit(name, small_fit, (train, validate)) for name in ("one", "other")]
    (drawing,) = comparison(maps).drawings
    assert [tick.get_text() for tick in drawing.figure.first().get_xticklabels()] == ["0.05"]
