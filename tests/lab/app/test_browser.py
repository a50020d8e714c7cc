"""The whole way in Chromium, with the network off: from the drop to the report without typing, at two sizes.

Pictures of every step are kept in the folder that GREYBOX_PICTURES names, to be looked at.
"""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import greybox_id as gb

pytest.importorskip("nicegui", reason="The page needs the extra app.")

pytestmark = pytest.mark.slow
MOST_CLICKS, MOST_SECONDS = 15, 300
SHIPPED = Path(gb.__file__).parent / "datasets" / "shipped"
DIAGNOSED = 900
"""Seconds to wait for a diagnosis, which takes half a minute of a free processor."""


def _processor_seconds(pid):
    """What a process and its commands that have ended took; others who use the machine do not lengthen that."""
    times = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:15]
    return sum(map(int, times)) / os.sysconf("SC_CLK_TCK")


def test_from_the_drop_to_the_report_without_typing(server, reader):
    process, page = server
    reader.driver.get(page["address"])
    reader.see("Take the shipped racer")
    reader.fits("1_empty")
    reader.click("Take the shipped racer")
    reader.see("Answer 1 question")
    reader.fits("1_question")
    reader.click("shipped map roboracer")
    reader.click("See it")
    reader.see("From above")
    reader.fits("2_see")
    reader.click("Check it")
    reader.see("Findings")
    reader.fits("3_check")
    reader.click("I have looked")
    reader.see("Which model?")
    reader.see("Root mean square")
    reader.fits("4_model")
    reader.click("Fit it")
    reader.see("objective")
    reader.see("Held out: racer_valid.csv")
    reader.driver.refresh()  # in the middle of it: the fit is found again
    reader.see("Errors by horizon")
    reader.fits("5_fit")
    reader.click("Why not better?")
    reader.click("Diagnose the fit")
    reader.see("What could be present undetected", DIAGNOSED)
    cause = next(b for b in reader.driver.find_elements("css selector", "button.cause") if "probability" in b.text)
    reader.driver.execute_script("arguments[0].dispatchEvent(new Event('mouseenter'))", cause)
    reader.see("alone: ")
    reader.fits("6_why")
    reader.click("Take it away")
    reader.see("Commands")
    reader.click("Write the report")
    reader.see("Open the report")
    reader.fits("7_take")
    assert reader.clicks <= MOST_CLICKS
    assert _processor_seconds(process.pid) < MOST_SECONDS
    folder = Path(page["session"])
    assert (folder / "report.html").stat().st_size > 20_000
    process.kill()  # nothing that was done is lost
    assert json.loads((folder / "recordings.json").read_text())["fit"] == "fits/1"
    assert gb.load(folder / "fits" / "1" / "fit.json").params.notna().all()


def test_a_wrong_sign_is_a_red_light_and_a_button_mends_it(server, reader, tmp_path):
    t = np.arange(0, 60, 0.05)
    v, steer = 8 + 2 * np.sin(t / 5), 0.06 * np.sin(t) + 0.04 * np.sin(2.3 * t)
    columns = {"time": t, "v_x": v, "steer": steer, "yaw_rate": v * steer / 2.7, "a_y": v * v * steer / 2.7}
    noise = np.random.default_rng(3)
    rows = np.column_stack(
        [values + 0.001 * noise.standard_normal(len(t)) * (k > 0) for k, values in enumerate(columns.values())]
    )
    file = tmp_path / "<b>lap & co.csv"
    np.savetxt(file, rows, delimiter=",", header=",".join(columns), comments="")
    _, page = server
    reader.driver.get(page["address"])
    reader.see("Take the shipped racer")
    reader.drop(file)
    reader.see("Every column has its signal.")
    reader.see("<b>lap & co.csv")
    reader.click("yaw_rate = yaw_rate")
    reader.see("turn its sign")
    reader.driver.find_element("css selector", ".menu .q-checkbox").click()
    reader.click("Change")
    reader.see("yaw_rate = −yaw_rate")
    reader.click("See it")
    reader.click("Check it")
    reader.see("Not to be trusted as it is")
    reader.fits("3_red")
    reader.click("Repair the map")
    reader.see("Can be used")
    reader.see("✓ yaw_rate: sign = 1")
    reader.fits("3_mended")


def test_before_and_after_say_what_changed(server, reader, tmp_path):
    files = [tmp_path / "racer_train.csv", tmp_path / "racer_valid.csv"]
    for file in files:  # 40 s of each, which are compared in half the time
        lines = (SHIPPED / file.name).read_text(encoding="utf-8").splitlines(keepends=True)
        file.write_text("".join(lines[:801]), encoding="utf-8")
    reader.driver.get(server[1]["address"])
    reader.drop(*files)
    reader.click("shipped map roboracer")
    reader.see("Read through the map roboracer.")
    reader.pick("role", "before")
    reader.pick("role", "fit", 1)
    reader.click("See it")
    reader.click("Check it")
    reader.click("I have looked")
    reader.see("Which model?")
    reader.click("6 Why not")
    reader.see("BEFORE: racer_train.csv")
    reader.click("What changed since BEFORE?")
    reader.see("Changed since", DIAGNOSED)
    reader.see("Unchanged within two standard deviations")
    reader.fits("6_since")
