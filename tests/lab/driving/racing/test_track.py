"""Closed lines: their curvature, speeds, and what is refused."""

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_lab.driving.racing.track import Usage, read_track, track

LIMITS = Usage(8.0, 3.0, 5.0, 7.0)


def circle(file, radius=5.0, points=40, widths=True, head="# x_m, y_m, w_tr_right_m, w_tr_left_m"):
    angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
    rows = [f"{radius * np.cos(a)},{radius * np.sin(a)}{',1.1,0.9' if widths else ''}" for a in angle]
    file.write_text("\n".join([head, *rows]))
    return file


def test_a_circle_has_one_curvature_and_one_speed(tmp_path):
    circuit = read_track(circle(tmp_path / "circle.csv"), LIMITS)
    assert circuit.half_width == pytest.approx(0.9)
    assert circuit.length == pytest.approx(2 * np.pi * 5.0, rel=1e-3)
    np.testing.assert_allclose(circuit.curvature, 0.2, rtol=5e-3)  # by differences
    np.testing.assert_allclose(circuit.speed, np.sqrt(8.0 / 0.2), rtol=3e-3)


def test_the_shipped_track_is_closed_and_as_narrow_as_asked():
    circuit = track(2.0, 1.0, LIMITS)
    assert np.max(np.abs(circuit.curvature)) == pytest.approx(0.5)
    turned = circuit.yaw[-1] - circuit.yaw[0]
    assert abs(abs(turned) - 2 * np.pi) < 0.05
    gaps = np.hypot(circuit.x - np.roll(circuit.x, 1), circuit.y - np.roll(circuit.y, 1))
    np.testing.assert_allclose(gaps, circuit.spacing, rtol=0.02)
    lateral = circuit.speed**2 * np.abs(circuit.curvature)
    assert np.max(lateral) <= 8.0 + 1e-9


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "points or more"),
        ("0,0\n1,0\n", "points or more"),
        ("\n".join("1,two" for _ in range(20)), "points or more"),
        ("\n".join(f"{k},nan" for k in range(20)), "points or more"),
        ("\n".join(f"{k},1e400,1,1" for k in range(20)), "not finite"),
        ("\n".join(f"{k},0,1,1" for k in range(20)), "encloses no area"),
        ("\n".join("0,0,1,1" for k in range(20)), "encloses no area"),
        ("0,0\n" * 3 + "1,0,3\n" * 30, "are needed"),
    ],
)
def test_what_is_no_track_is_a_sentence(tmp_path, text, said):
    (tmp_path / "line.csv").write_text(text)
    with pytest.raises(BadInput, match=said):
        read_track(tmp_path / "line.csv", LIMITS)


def test_widths_that_are_not_stated_or_too_large_are_sentences(tmp_path):
    with pytest.raises(BadInput, match="has no columns of widths"):
        read_track(circle(tmp_path / "circle.csv", widths=False, head="x,y"), LIMITS)
    assert read_track(circle(tmp_path / "circle.csv", widths=False, head="x,y"), LIMITS, 1.0).half_width == 1.0
    with pytest.raises(BadInput, match="narrowest bend"):
        read_track(circle(tmp_path / "circle.csv"), LIMITS, 6.0)
    with pytest.raises(BadInput, match="cannot be read"):
        read_track(tmp_path / "nothing.csv", LIMITS)
