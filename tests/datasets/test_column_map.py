"""Column maps: the shipped ones hold, and a slip in a user's own is answered with a sentence."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from greybox_id.base.errors import BadInput, GreyboxError
from greybox_id.base.signals import SIGNALS
from greybox_id.base.units import to_si
from greybox_id.datasets.column_map import column_map, parse_column_map, shipped_maps

GOOD = """
name = "mine"
hold = "linear"
[time]
column = "t"
unit = "ms"
[signals.v_x]
column = "Speed"
unit = "m/s"
divide_by = 4244
[signals.yaw_rate]
column = "gyro"
unit = "deg/s"
sign = -1
offset = 0.01
[extra.gear_speed]
column = "n"
unit = "rpm"
optional = true
[runs]
column = "lap"
"""


def test_shipped_maps_can_all_be_read_and_say_where_their_files_come_from():
    assert set(shipped_maps()) == {"canonical", "roboracer", "truck", "revs_250lm", "dart"}
    for name in shipped_maps():
        mapping = column_map(name)
        assert mapping.name == name
        assert mapping.about
        assert mapping.source


def test_canonical_maps_every_signal_to_itself_in_si_units():
    canonical = column_map("canonical")
    assert set(canonical.signals) == set(SIGNALS)
    for name, column in canonical.signals.items():
        assert (column.column, column.unit, column.optional) == (name, SIGNALS[name].unit, True)
    assert canonical.time.column == "time"


def test_a_map_from_a_file_is_read(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD)
    mapping = column_map(path)
    assert mapping.hold == "linear"
    assert mapping.run_column == "lap"
    assert mapping.signals["v_x"].scale == pytest.approx(1 / 4244)
    assert mapping.extra["gear_speed"].si_unit == "rad/s"


@pytest.mark.parametrize(
    ("unit", "target", "factor"),
    [
        ("deg/s", "rad/s", 0.017453292519943295),
        ("°/s", "rad/s", 0.017453292519943295),
        ("g", "m/s^2", 9.80665),
        ("g_0", "m/s^2", 9.80665),
        ("km/h", "m/s", 1 / 3.6),
        ("rpm", "rad/s", 0.10471975511965977),
        ("ms", "s", 1e-3),
        ("m/s²", "m/s^2", 1.0),
        ("kN", "N", 1000.0),
    ],
)
def test_units_are_converted(unit, target, factor):
    assert to_si(unit, target).factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "target"),
    [
        ("deg", "rad/s"),
        ("Hz", "rad/s"),
        ("g", "rad"),
        ("foo", "m"),
        ("m^9^9^9", "m"),
        ("dB", None),
        ("", "m"),
        ("kg", "N"),
    ],
)
def test_units_of_the_wrong_kind_are_refused(unit, target):
    with pytest.raises(BadInput):
        to_si(unit, target)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[signals.yaw_rate]", "[signals.yawrate]", ["yawrate", "Did you mean yaw_rate?", "[extra.yawrate]"]),
        ('unit = "deg/s"', 'unit = "deg"', ["[signals.yaw_rate]", '"deg"', "rad/s"]),
        ('unit = "deg/s"', 'unit = "dgs"', ["[signals.yaw_rate]", '"dgs"', "not known"]),
        ('unit = "deg/s"', "", ["[signals.yaw_rate]", "no unit"]),
        ("sign = -1", "sgn = -1", ['"sgn"', "Did you mean sign?"]),
        ("sign = -1", "sign = 2", ["sign = 2", "1 or -1"]),
        ("sign = -1", 'sign = "-"', ["sign", "finite number"]),
        ("divide_by = 4244", "divide_by = 0", ["divide_by"]),
        ("offset = 0.01", "offset = inf", ["offset", "finite"]),
        ('hold = "linear"', 'hold = "cubic"', ["hold", "'zero', 'linear'"]),
        ("[extra.gear_speed]", "[extra.steer]", ["[extra.steer]", "[signals.steer]"]),
        ("optional = true", "optional = 1", ["optional", "true or false"]),
        ('[time]\ncolumn = "t"\nunit = "ms"', "", ["[time]"]),
        ('name = "mine"', "name = mine", ["line 2", "not valid TOML"]),
        ("[runs]", "[rusn]", ['"rusn"', "Did you mean runs?"]),
    ],
)
def test_a_slip_in_a_map_is_answered_with_what_and_where(old, new, words):
    assert old in GOOD
    with pytest.raises(BadInput) as error:
        parse_column_map(GOOD.replace(old, new), "mine.toml")
    assert str(error.value).startswith("mine.toml:")
    for word in words:
        assert word in str(error.value)


def test_an_unknown_map_is_answered_with_the_nearest_name(tmp_path):
    with pytest.raises(BadInput, match=r"Did you mean roboracer\?"):
        column_map("roboracr")
    with pytest.raises(BadInput, match="cannot be read"):
        column_map(tmp_path / "none.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInput, match="UTF-8"):
        column_map(tmp_path / "bytes.toml")


@settings(max_examples=150)
@given(
    position=st.integers(0, len(GOOD)),
    length=st.integers(0, 30),
    text=st.text(st.characters(min_codepoint=9, max_codepoint=300), max_size=12),
)
def test_a_mutated_map_never_ends_in_a_traceback(position, length, text):
    with suppress(GreyboxError):
        parse_column_map(GOOD[:position] + text + GOOD[position + length :], "mine.toml")


@settings(max_examples=150)
@given(st.text(st.sampled_from("mskgradeN/^*-12 .()°²_%Hz"), max_size=14))
def test_any_unit_is_converted_or_refused(unit):
    with suppress(GreyboxError):
        assert to_si(unit).unit


def test_a_lookup_bends_values_before_their_unit_is_converted():
    column = parse_column_map(
        '[time]\nunit="s"\n[signals.steer]\nunit="deg"\nscale=0.01\nlookup=[[-1, 0, 1], [-20, 1, 10]]', "m.toml"
    ).signals["steer"]
    found = column.convert(np.array([-100.0, -50.0, 0.0, 50.0, 100.0, 300.0, np.nan]))
    np.testing.assert_allclose(np.degrees(found), [-20, -9.5, 1, 5.5, 10, 10, np.nan])


@pytest.mark.parametrize(
    "points", ["[[0, 1], [0]]", "[[0], [1]]", "[[1, 0], [0, 1]]", "[1, 2]", "'x'", "[[0, 1], [0, 'a']]"]
)
def test_a_lookup_that_is_none_is_refused(points):
    with pytest.raises(BadInput, match="lookup"):
        parse_column_map(f'[time]\nunit="s"\n[signals.steer]\nunit="rad"\nlookup={points}', "m.toml")


def test_poses_need_x_y_and_yaw_and_known_keys():
    signals = "".join(f'[signals.{name}]\nunit="{unit}"\n' for name, unit in (("x", "m"), ("y", "m"), ("yaw", "rad")))
    head = '[time]\nunit="s"\n'
    own = parse_column_map(f"[[poses]]\nif_column='a'\n[[poses]]\nforward=1.5\n{head}{signals}", "m.toml").poses
    assert [(own.if_column, own.forward) for own in own] == [("a", 0.0), ("", 1.5)]
    for text, words in (
        (f"[poses]\n{head}[signals.x]\nunit='m'", "map y, yaw under"),
        (f"[poses]\nforwards=1\n{head}{signals}", "Did you mean forward"),
        (f"poses=3\n{head}{signals}", "must be a table"),
        (f"[poses]\nleft='a'\n{head}{signals}", "finite number"),
    ):
        with pytest.raises(BadInput, match=words):
            parse_column_map(text, "m.toml")


@pytest.mark.parametrize("column", ["[]", "[1]", "['a', ' ']", "3"])
def test_names_of_a_column_are_text(column):
    with pytest.raises(BadInput, match="column must be"):
        parse_column_map(f'[time]\nunit="s"\n[signals.v_x]\nunit="m/s"\ncolumn={column}', "m.toml")
