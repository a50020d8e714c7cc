"""A tyre rig's recording: the magic formula behind it comes back, with what temperatures and pressures make of it."""

import numpy as np
import pandas as pd
import pytest
from calling import greybox
from json_pages import PAGE, agree, never_met

from greybox_id.base.errors import BadInput
from greybox_id.fitting.tyre_rig import fit_tyre
from greybox_id.models.tyre_file import parse_tyre_file, read_tyre_file

TYRE = parse_tyre_file(
    "FITTYP = 52\nFNOMIN = 1100\nPCY1 = 1.5\nPDY1 = 2.3\nPDY2 = -0.4\nPEY1 = -0.08\nPEY2 = -0.1\nPKY1 = 31\n"
    "PKY2 = 1.28\n"
    "PKY4 = 2\nPHY1 = 0.0025\nPVY1 = 0.01\n",
    "true.tir",
)


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Sweeps at four loads, three pressures and temperatures, in SAE's axes: force and load negative."""
    rng, rows = np.random.default_rng(0), []
    slip = np.radians(12 * np.sin(np.linspace(0, 2 * np.pi, 120)))
    for pressure in (70, 83, 97):
        for temperature in (40, 60, 80):
            for load in (300.0, 600.0, 900.0, 1200.0):
                curve = TYRE.at(load)
                friction = 1 - 0.002 * (temperature - 60)
                force = friction * np.array([curve.force(own, load) for own in slip]) + 8 * rng.standard_normal(
                    len(slip)
                )
                rows.append(
                    pd.DataFrame(
                        {
                            "SA": np.degrees(slip),
                            "IA": 0.0,
                            "FZ": -load,
                            "FY": -force,
                            "P": pressure,
                            "TSTC": temperature,
                        }
                    )
                )
    table = pd.concat(rows)
    table.insert(0, "ET", np.arange(len(table)) * 0.02)
    file = tmp_path_factory.mktemp("rig") / "B1654run21.dat"
    units = "sec\tdeg\tdeg\tN\tN\tkPa\tdeg C"
    head = f"TTC test\t$2$run21\tLb\n{chr(9).join(table.columns)}\n{units}\n"
    file.write_text(head + table.to_csv(sep="\t", index=False, header=False, float_format="%.4f"))
    return file


def test_the_formula_behind_a_rig_comes_back(rig):
    found = fit_tyre([rig])
    assert found.usable
    assert found.explained > 0.99
    for load in (300.0, 750.0, 1200.0):
        true = TYRE.at(load)
        made = parse_tyre_file("\n".join(f"{k} = {v}" for k, v in found.numbers.items()), "made.tir").at(load)
        for slip in (-0.15, -0.03, 0.03, 0.15):
            assert made.force(slip, load) == pytest.approx(true.force(slip, load), rel=0.04)
    assert len(found.bands) == 9
    assert found.friction_spread == pytest.approx(0.04, abs=0.015)
    assert found.stiffness_spread == pytest.approx(0.04, abs=0.03)


def test_forces_may_be_named_as_symbols_are_written(rig, tmp_path):
    file = tmp_path / "symbols.dat"
    file.write_text(rig.read_text().replace("FZ\tFY", "F_z\tF_y"))
    assert fit_tyre([file]).numbers == fit_tyre([rig]).numbers


def test_the_command_writes_a_tyre_property_file(rig, tmp_path):
    done = greybox("fit", "--model", "tyre", rig, "--out", tmp_path / "mine.tir")
    assert done.code == 0, done.err
    assert "usable as a prior" in done.out
    told = greybox("fit", "--model", "tyre", rig, "--out", tmp_path / "again.tir", "--json").told
    agree(told, PAGE["fit, tyre"])
    assert list(never_met(PAGE["fit, tyre"])) == []
    stated = read_tyre_file(tmp_path / "mine.tir").stated()
    assert stated["D_f"].sd >= 0.3 * stated["D_f"].value


def test_what_is_no_rig_or_was_never_swept_is_refused(rig, tmp_path):
    table = pd.DataFrame({"SA": np.full(500, 1.0), "FZ": 600.0, "FY": 900.0})
    table.to_csv(tmp_path / "still.csv", index=False)
    with pytest.raises(BadInput, match="both sides"):
        fit_tyre([tmp_path / "still.csv"])
    table.drop(columns="FZ").to_csv(tmp_path / "no.csv", index=False)
    with pytest.raises(BadInput, match="load"):
        fit_tyre([tmp_path / "no.csv"])
