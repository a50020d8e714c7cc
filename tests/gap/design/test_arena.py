"""Arenas: what is in them, and how paths are laid into them."""

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.gap.design.arena import arena


def test_a_circle_fits_into_a_disc_of_its_radius_and_not_into_a_smaller_one():
    around = np.linspace(0, 2 * np.pi, 200)
    x, y = 10 * np.sin(around), 10 * (1 - np.cos(around))
    placed = arena("disc:10.5").place(x, y)
    assert placed.outside == pytest.approx(-0.5, abs=0.1)
    assert np.hypot(*placed.placed(x, y)).max() == pytest.approx(10, abs=0.1)
    assert arena("disc:9").place(x, y).outside == pytest.approx(1.0, abs=0.1)


def test_a_straight_takes_a_path_as_long_as_it_is():
    x, y = np.linspace(0, 100, 50), np.linspace(0, 3, 50)
    assert arena("straight:120x8").place(x, y).outside < 0
    assert arena("straight:90x8").place(x, y).outside > 4.0
    assert arena("straight:120x8").length == pytest.approx(np.hypot(120, 8))
    assert arena("straight:120x8").breadth == pytest.approx(8.0, rel=0.1)


def test_an_outline_that_is_not_convex_keeps_paths_out_of_its_notch(tmp_path):
    file = tmp_path / "field.csv"
    file.write_text("x,y\n0,0\n40,0\n40,40\n30,40\n30,10\n10,10\n10,40\n0,40\n0,0\n")
    field = arena(str(file))
    assert len(field.outline) == 8
    assert field.outside(np.array([20.0]), np.array([5.0])) == pytest.approx(-5.0)
    assert field.outside(np.array([20.0]), np.array([30.0])) == pytest.approx(10.0)
    x = np.linspace(0, 30, 40)
    assert field.place(x, np.zeros(40)).outside < 0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("ring:3", "not an arena"), ("disc:nan", "not an arena"), ("disc:0", "no size"), ("straight:1e9x3", "no size"),
        ("straight:120", "not an arena"), ("nowhere.csv", "cannot be read"), ("disc:1.2.3", "no size"),
    ],
)  # fmt: skip
def test_what_is_no_arena_is_a_sentence(words, told):
    with pytest.raises(BadInput, match=told):
        arena(words)


@pytest.mark.parametrize(
    "text", ["a,b\n1,2\n", "x,y\n0,0\n1,1\n", "x,y\n0,0\n1,nan\n2,0\n", "x,y\n0,0\n1,q\n2,0\n", ""]
)
def test_a_file_that_is_no_outline_is_a_sentence(tmp_path, text):
    file = tmp_path / "field.csv"
    file.write_text(text)
    with pytest.raises(BadInput, match="outline"):
        arena(str(file))
