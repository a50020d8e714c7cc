"""What is too large, what unpacks without end, two pages, and an end in the middle of a fit."""

import gzip
import json
import signal
from pathlib import Path

import numpy as np
import pytest

import greybox_id as gb

pytest.importorskip("nicegui", reason="The page needs the extra app.")
pytestmark = pytest.mark.slow


def test_two_gigabytes_and_a_bomb_are_sentences(server, reader, tmp_path):
    large, bomb = tmp_path / "large.csv", tmp_path / "bomb.csv.gz"
    with large.open("wb") as opened:
        opened.truncate(2 * 2**30)
    with gzip.open(bomb, "wb", compresslevel=1) as opened:
        for _ in range(1000):
            opened.write(b"0,0\n" * 2**18)
    reader.driver.get(server[1]["address"])
    reader.drop(large)
    reader.see("A file of more than 500 MB is too large")
    reader.drop(bomb)
    reader.see("This file cannot be read.")
    reader.see("more than 1 GB of text once it is unzipped")


def test_files_on_their_way_arrive_although_the_page_is_drawn_anew(server, reader, tmp_path):
    t = np.arange(0, 40, 0.05)
    files = [tmp_path / f"part{k}.csv" for k in range(3)]
    for k, file in enumerate(files):  # each takes longer than the one before
        rows = np.column_stack((t, 8 + np.sin(t + k), 0.1 * np.sin(t), 0.3 * np.sin(t)))[: len(t) * (k + 1) // 3]
        np.savetxt(file, rows, delimiter=",", header="time,v_x,steer,yaw_rate", comments="")
    reader.driver.get(server[1]["address"])
    reader.see("Take the shipped racer")
    slow = {"offline": False, "latency": 0, "downloadThroughput": -1, "uploadThroughput": 12_000}
    reader.driver.execute_cdp_cmd("Network.enable", {})
    reader.driver.execute_cdp_cmd("Network.emulateNetworkConditions", slow)
    reader.drop(*files)
    for file in files:
        reader.see(file.name, 60)


def test_two_pages_show_the_same_and_a_kill_in_the_middle_of_a_fit_loses_nothing(start, reader):
    process, page = start()
    reader.driver.get(page["address"])
    reader.click("Take the shipped racer")
    reader.click("shipped map roboracer")
    first = reader.driver.current_window_handle
    reader.driver.switch_to.new_window("tab")
    reader.driver.get(page["address"])
    reader.click("See it")
    reader.click("Check it")
    reader.click("I have looked")
    reader.see("Root mean square")
    reader.click("Fit it")
    reader.see("objective")
    second = reader.driver.current_window_handle
    reader.driver.switch_to.window(first)
    reader.see("greybox fit --model lateral")  # what runs is shown on both
    reader.driver.close()
    reader.driver.switch_to.window(second)
    process.send_signal(signal.SIGKILL)
    process.wait()
    _, page = start()
    reader.driver.get(page["address"])
    reader.see("Errors by horizon")
    folder = Path(page["session"])
    assert json.loads((folder / "recordings.json").read_text("utf-8"))["fit"] == "fits/1"
    assert gb.load(folder / "fits" / "1" / "fit.json").params.notna().all()
