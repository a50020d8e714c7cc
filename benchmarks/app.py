"""How quick the page is: an hour at 100 Hz of eight channels in Chromium, from the start to a slider's trace.

    python benchmarks/app.py

Needs the extra app, selenium, chromium and chromedriver. Wall time, which a busy machine lengthens: the load stands
beside. Of what is done often the median and the least.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from selenium import webdriver
from selenium.webdriver.common.keys import Keys

RATE, SECONDS = 100.0, 3600
TIMES = 15
"""How often one zooms and moves a slider."""
PAINTED = """
const chart = [...document.querySelectorAll('[role=img] canvas')].find(each => each.getClientRects().length);
if (!chart) return 0;
const points = chart.getContext('2d').getImageData(0, 0, chart.width, chart.height).data;
let inked = 0;
for (let k = 3; k < points.length; k += 4) inked += points[k] > 0;
return inked;
"""
INKED = 20_000
"""Pixels with ink from which on curves are there, and not axes alone."""
WATCHED = """
window.took = [];
const drawn_charts = [...document.querySelectorAll("[role=img]")].filter(e => e.getClientRects().length);
const element = drawn_charts.find(e => e.querySelector("canvas"));
const chart = getElement(+element.id.slice(1)).chart, drawn = chart.setOption.bind(chart);
document.addEventListener('keydown', () => { window.began = performance.now(); }, true);
window.zoomed = (low, high) => {
  window.began = performance.now();
  chart.dispatchAction({type: 'dataZoom', startValue: low, endValue: high});
};
chart.setOption = (...given) => {
  drawn(...given);
  chart.getZr().flush();
  window.took.push(performance.now() - window.began);
};
"""


def main() -> int:
    """Run the benchmark."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "hour.csv"
        _write(file)
        began = time.perf_counter()
        process, address = _started(Path(folder), file)
        started = time.perf_counter() - began
        driver = _browser()
        try:
            _measure(driver, process.pid, address, started)
        finally:
            driver.quit()
            process.terminate()
            process.wait(20)
    return 0


def _measure(driver: Any, pid: int, address: str, started: float) -> None:
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    print(f"start to page: {started:.2f} s")
    driver.get(address)
    _see(driver, "Every column has its signal.")
    time.sleep(3.0)  # a person reads what it says
    began = time.perf_counter()
    _click(driver, "See it")
    while driver.execute_script(PAINTED) < INKED:
        time.sleep(0.01)
    print(f"first paint: {time.perf_counter() - began:.2f} s")
    driver.execute_script(WATCHED)
    draw = np.random.default_rng(0)
    for width in draw.choice([10.0, 60.0, 600.0], TIMES):
        low = draw.uniform(0.0, SECONDS - width)
        driver.execute_script(f"window.zoomed({low}, {low + width})")
        time.sleep(0.5)
    _say("zoom", driver.execute_script("return window.took"))
    _click(driver, "Check it")
    _see(driver, "Findings")
    _click(driver, "I have looked")
    _see(driver, "Root mean square")
    driver.execute_script(WATCHED)
    for k in range(TIMES):
        driver.find_elements("css selector", ".q-slider [tabindex='0'], .q-slider[tabindex='0']")[k % 3].send_keys(
            Keys.ARROW_RIGHT
        )
        time.sleep(0.5)
    _say("slider to trace, 4 000 rows", driver.execute_script("return window.took"))
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines() if ":" in line)
    print(
        f"memory: {int(status['VmRSS'].split()[0]) / 1024:.0f} MB, at most {int(status['VmHWM'].split()[0]) / 1024:.0f}"
    )


def _say(what: str, milliseconds: list[float]) -> None:
    print(f"{what}: median {median(milliseconds):.0f} ms, least {min(milliseconds):.0f} ms of {len(milliseconds)}")


def _write(file: Path) -> None:
    """A drive whose channels go together, with noise."""
    t = np.arange(0, SECONDS, 1 / RATE)
    noise = np.random.default_rng(0)
    v, steer = 20 + 5 * np.sin(t / 17), 0.03 * np.sin(t / 1.3) + 0.02 * np.sin(t / 3.1)
    turn = v * steer / 2.7
    columns = {
        "v_x": (v, 0.01), "v_y": (-0.1 * turn, 0.01), "yaw_rate": (turn, 1e-3), "a_y": (v * turn, 0.01),
        "a_x": (np.gradient(v, t), 0.01), "steer": (steer, 5e-5), "roll": (1e-3 * v * turn, 1e-3),
        "yaw": (np.cumsum(turn) / RATE, 1e-3),
    }  # fmt: skip
    rows = [t, *(values + sd * noise.standard_normal(len(t)) for values, sd in columns.values())]
    names = ",".join(("time", *columns))
    np.savetxt(file, np.column_stack(rows), "%.6g", ",", header=names, comments="")


def _started(folder: Path, file: Path) -> tuple[subprocess.Popen[str], str]:
    code = "from greybox_id.cli import main; main()"
    command = [sys.executable, "-c", code, "app", "--no-browser", "--json", str(file)]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
    lines = ""
    while "}" not in lines:
        lines += process.stdout.readline() if process.stdout else ""
    return process, json.loads(lines)["address"]


def _browser() -> Any:
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    for word in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1280,800"):
        options.add_argument(word)
    return webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))


def _see(driver: Any, words: str) -> None:
    while words not in driver.find_element("tag name", "body").text:
        time.sleep(0.05)


def _click(driver: Any, words: str) -> None:
    button = next(each for each in driver.find_elements("tag name", "button") if words in each.text)
    driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", button)
    button.click()


if __name__ == "__main__":
    sys.exit(main())
