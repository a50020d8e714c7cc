"""Recordings of strangers from the drop to a fit: what is not sure is asked, and few clicks answer it."""

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="The page needs the extra app.")
pytestmark = pytest.mark.slow
MOST_CLICKS = 25
FOLDER = Path(os.environ.get("GREYBOX_DATA", ""))
recorded = pytest.mark.skipif(not os.environ.get("GREYBOX_DATA"), reason="GREYBOX_DATA names no recordings.")


def fitted(reader):
    """From columns that are mapped to a fit."""
    reader.see("See it")
    reader.click("See it")
    reader.click("Check it")
    reader.see("Findings")
    if "Repair the map" in reader.text:
        reader.click("Repair the map")
        reader.see("✓")
    reader.click("I have looked")
    reader.see("Root mean square")
    model = reader.text
    reader.click("Fit it")
    reader.see("Errors by horizon")
    assert reader.clicks <= MOST_CLICKS
    return model


@recorded
def test_a_hand_wheel_is_asked_about(server, reader):
    reader.driver.get(server[1]["address"])
    reader.drop(*(FOLDER / "kia_ev6" / f"test{k}.csv.gz" for k in (1, 2)))
    reader.see("Answer 1 question")
    reader.see("the hand wheel's angle")
    reader.fits("kia_question")
    reader.click("Yes, divided")
    fitted(reader)


@recorded
@pytest.mark.examination
def test_topics_of_one_drive_are_joined_and_a_turned_imu_is_repaired(server, reader):
    reader.driver.get(server[1]["address"])
    topics = ("odomData", "imuData", "commandData", "pfOdomData")
    reader.drop(*(FOLDER / "frictionmaps_ds3" / f"{topic}.csv.gz" for topic in topics))
    for topic in topics:
        reader.see(f"{topic}.csv.gz")
    reader.click("They are parts of one drive")
    reader.see("imuData/wx")
    while left := reader.text.count("No, leave it out"):
        reader.click("No, leave it out")
        reader.wait(lambda left=left: reader.text.count("No, leave it out") < left, "the next question")
    reader.click("Join the files")
    assert "roboracer" in fitted(reader)  # of all shipped vehicles the nearest
    assert "a_x" in (Path(server[1]["session"]) / "map.toml").read_text("utf-8")


def test_a_logger_of_phones_with_its_preamble(server, reader, tmp_path):
    t = np.arange(0, 60, 0.04)
    v, steer = 15 + 3 * np.sin(t / 6), 0.03 * np.sin(t / 1.4) + 0.02 * np.sin(t / 0.7)
    lateral = v * v * steer / (2.7 + 0.004 * v * v) / 9.81 + 0.005 * np.random.default_rng(1).standard_normal(len(t))
    ahead = np.gradient(v, t) / 9.81
    head = ("This file is created using RaceChrono Pro.\nFormat,3\nSession title,X\nNote,\n\n"
            "timestamp,elapsed_time,speed,lateral_acc,longitudinal_acc,steering_angle\nunix time,s,m/s,G,G,deg\n"
            ",,100: gps,calc,calc,200: obd\n")  # fmt: skip
    rows = [
        f"{1.7e9 + row[0]:.2f},{100 + row[0]:.2f}," + ",".join(f"{value:.5f}" for value in row[1:])
        for row in zip(t, v, lateral, ahead, np.rad2deg(15 * steer), strict=True)
    ]
    file = tmp_path / "session_20250101.csv"
    file.write_text(head + "\n".join(rows) + "\n", "utf-8")
    reader.driver.get(server[1]["address"])
    reader.drop(file)
    reader.see("session_20250101")
    reader.see("Answer 1 question")
    reader.see("the hand wheel's angle")  # a_y and speed tell it: a road wheel that far turned would slide
    reader.click("Yes, divided")
    fitted(reader)


@recorded
def test_without_steering_the_page_says_what_is_lacking(server, reader):
    case = FOLDER.parent / "cases" / "c06_racechrono.csv"
    if not case.is_file():
        pytest.skip("The cases are not here.")
    reader.driver.get(server[1]["address"])
    reader.drop(case)
    reader.click("See it")
    reader.click("Check it")
    reader.click("I have looked")
    reader.see("No model can be simulated on this recording.")
    reader.see("lacks steer, which lateral needs.")
