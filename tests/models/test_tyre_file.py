"""Tyre property files: read as CommonRoad's public Magic Formula has them, refused where they are hostile."""

from math import pi
from types import SimpleNamespace

import numpy as np
import pytest
from calling import refused

from greybox_id.base.errors import BadInput
from greybox_id.models.tyre_file import parse_tyre_file, read_tyre_file
from greybox_id.models.vehicle import vehicle

ADAMS = {
    "PCY1": 1.3507, "PDY1": 1.0489, "PDY2": -0.15, "PDY3": -2.8821, "PEY1": -0.0074722, "PEY2": -0.0063208, "PEY3": 0.3,
    "PKY1": -21.92, "PKY2": 2.0012, "PKY3": -0.024778, "PHY1": 0.0026747, "PHY2": 8.9094e-05, "PVY1": 0.037318,
    "PVY2": -0.010049, "PTY1": 2.1439, "PTY2": 1.9829, "PCX1": 1.64, "QBZ1": 10.9, "RBX1": 13.3,
}  # fmt: skip
"""Lateral coefficients of the passenger car tyre of CommonRoad's table, with terms of load beside them."""


def text(numbers, form="PAC2002", load=4850.0, **more):
    lines = ["[MDI_HEADER]", "FILE_TYPE = 'tir'", "[UNITS]", "FORCE = 'newton'", "ANGLE = 'radians'", "[MODEL]"]
    lines += [f"PROPERTY_FILE_FORMAT = '{form}'", "[VERTICAL]", f"FNOMIN = {load} $nominal load", "! a comment = 3"]
    lines += [f"{key} = {value} $a note" for key, value in (numbers | more).items()]
    return "\n".join(lines)


def book(alpha, F_z, n, load):
    """Pacejka, 3rd ed., Eq. 4.E19 to 4.E30 without camber, pressure and turn slip, written down again."""
    df = (F_z - load) / load
    a = alpha + n.get("PHY1", 0) + n.get("PHY2", 0) * df
    C, mu = n["PCY1"], n["PDY1"] + n.get("PDY2", 0) * df
    E = n.get("PEY1", 0) + n.get("PEY2", 0) * df
    K = n["PKY1"] * load * np.sin(n.get("PKY4", 2.0) * np.arctan(F_z / (n["PKY2"] * load)))
    B = K / (C * mu * F_z)
    S_v = F_z * (n.get("PVY1", 0) + n.get("PVY2", 0) * df)
    return mu * F_z * np.sin(C * np.arctan(B * a - E * (B * a - np.arctan(B * a)))) + S_v


@pytest.mark.parametrize("more", [{}, {"PKY4": 1.7}])
@pytest.mark.parametrize("share", [0.3, 1.0, 1.9])
def test_forces_are_those_of_the_book_at_any_load(share, more):
    tyre, load = parse_tyre_file(text(ADAMS | more), "x.tir"), 4850.0
    at = tyre.at(share * load)
    for alpha in np.linspace(-0.4, 0.4, 41):
        truth = -book(alpha, share * load, ADAMS | more, load)  # slip angles of such files are those of the other side
        assert at.force(alpha, share * load) == pytest.approx(truth, rel=1e-9, abs=1e-6)


def test_forces_are_those_of_a_public_implementation():
    """CommonRoad's formula_lateral knows no load: K_y is p_ky1 F_z, as with PKY2 = 1 at the nominal load."""
    tire_model = pytest.importorskip("vehiclemodels.utils.tire_model", reason="pip install 'greybox-id[exam]'")
    numbers = {key: value for key, value in ADAMS.items() if key in ("PCY1", "PDY1", "PEY1", "PKY1", "PHY1", "PVY1")}
    tyre, load = parse_tyre_file(text(numbers, PKY2=1.0), "x.tir").at(), 4850.0
    p = SimpleNamespace(
        p_cy1=1.3507,
        p_dy1=1.0489,
        p_dy3=0.0,
        p_ey1=-0.0074722,
        p_ky1=-21.92,
        p_hy1=0.0,
        p_hy3=0.0,
        p_vy1=0.0,
        p_vy3=0.0,
    )
    plain = parse_tyre_file(text({k: v for k, v in numbers.items() if k[1] not in "HV"}, PKY2=1.0), "x.tir").at()
    for alpha in np.linspace(-0.5, 0.5, 101):
        theirs, _ = tire_model.formula_lateral(alpha, 0.0, load, p)
        assert plain.force(alpha, load) == pytest.approx(-theirs, rel=1e-6, abs=1e-6)
    assert tyre.S_h == 0.0026747


def test_the_plane_tyre_of_the_book_has_its_slope_and_peak():
    tyre = parse_tyre_file(text({"PCY1": 1.3, "PDY1": 1.0, "PEY1": -1.0, "PKY1": 14.0, "PKY2": 1.0}), "x.tir").at()
    slope = (tyre.force(1e-7, 1.0) - tyre.force(-1e-7, 1.0)) / 2e-7
    assert slope == pytest.approx(14.0 * np.sin(2 * np.arctan(1.0)), rel=1e-9)
    assert max(tyre.force(a, 1.0) for a in np.linspace(0, pi / 2, 2000)) == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize(
    ("numbers", "version"), [({"FITTYP": 6}, "5.2"), ({"FITTYP": 61}, "6.1"), ({"FITTYP": 62}, "6.2"), ({}, "5.2")]
)
def test_versions_are_told_apart(numbers, version):
    assert parse_tyre_file(text(ADAMS | numbers), "x.tir").version == version


def test_what_is_ignored_is_named():
    ignored = parse_tyre_file(text(ADAMS), "x.tir").ignored
    assert {"longitudinal slip", "combined slip", "camber", "asymmetric curvature", "relaxation"} <= set(ignored)
    assert "inflation pressure" not in ignored


def test_a_vehicle_file_takes_its_tyres_from_beside_it(tmp_path):
    (tmp_path / "front.tir").write_text(text(ADAMS))
    (tmp_path / "car.toml").write_text(
        'tyre_file = "front.tir"\n[parameters]\nm = 1500\nD_r = { value = 0.9, sd = 0.1 }\n'
    )
    car = vehicle(tmp_path / "car.toml")
    assert car.values["C_f"].value == 1.3507
    assert car.values["D_r"].value == 0.9  # what the file states itself stands
    # half of what half the nominal load more and less make of it, and the belt's friction
    assert car.values["D_f"].sd == pytest.approx(np.hypot(0.075, 0.3 * car.values["D_f"].value))
    assert car.values["C_f"].sd is None
    assert car.values["B_f"].source == "front.tir: Magic Formula 5.2 at 4850 N"


HOSTILE = {
    "nothing": "",
    "binary": "\x00\xff" * 500,
    "no tyre": "FNOMIN = 4000\nPCY1 = 1.3\nPDY1 = 1\n",
    "nan": text(ADAMS | {"PKY1": "nan"}),
    "infinite": text(ADAMS | {"PKY1": "1e999"}),
    "huge": text(ADAMS | {"PCX1": "1e300"}),
    "word": text(ADAMS | {"PDY1": "__import__('os')"}),
    "no load": text(ADAMS, load=0.0),
    "negative load": text(ADAMS, load=-1.0),
    "zero shape": text(ADAMS | {"PCY1": 0.0}),
    "no stiffness": text(ADAMS | {"PKY1": 0.0}),
    "zero scale": text(ADAMS | {"PKY2": 0.0}),
    "tiny": text(ADAMS | {"PCY1": 1e-99, "PDY1": 1e-99, "PKY1": 1e99}),
    "pounds": text(ADAMS).replace("'newton'", "'pound_force'"),
    "degrees": text(ADAMS).replace("'radians'", "'degree'"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_end_in_a_sentence(name, tmp_path):
    (tmp_path / "x.tir").write_bytes(HOSTILE[name].encode("latin-1"))
    with pytest.raises(BadInput, match=r"x\.tir"):
        read_tyre_file(tmp_path / "x.tir")
    assert "x.tir" in refused("import", tmp_path / "x.tir", "--out", tmp_path / "car.toml")
    assert not (tmp_path / "car.toml").exists()


def test_a_file_that_is_too_large_is_not_read_whole(tmp_path):
    (tmp_path / "x.tir").write_bytes(b"A = 1\n" * 500_000)
    with pytest.raises(BadInput, match="larger than 1 MB"):
        read_tyre_file(tmp_path / "x.tir")


@pytest.mark.parametrize("named", ["3", '"tyre.toml"', '["x.tir"]', '"none.tir"', '"\\u0000.tir"'])
def test_a_tyre_file_that_is_none_is_a_sentence(tmp_path, named):
    (tmp_path / "car.toml").write_text(f"tyre_file = {named}\n")
    with pytest.raises(BadInput):
        vehicle(tmp_path / "car.toml")
