"""The whole way in Chromium, with the network off: from the drop to the report without typing, at two sizes.

Pictures of every step are kept in the folder that GREYBOX_PICTURES names, to be looked at.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import greybox_id as gb

pytest.importorskip("nicegui", reason="The page needs the extra app.")
webdriver = pytest.importorskip("selenium.webdriver", reason="Selenium drives the browser: pip install selenium.")

pytestmark = pytest.mark.slow
SIZES = ((1280, 800), (1920, 1080))
MOST_CLICKS, MOST_SECONDS = 15, 300


class Reader:
    """Who looks at the page and clicks."""

    def __init__(self, driver):
        self.driver, self.clicks = driver, 0

    @property
    def text(self):
        return self.driver.find_element("tag name", "body").text

    def see(self, words, seconds=240):
        until = time.time() + seconds
        while words not in self.text:
            assert time.time() < until, f"{words!r} is not seen in:\n{self.text}"
            time.sleep(0.1)

    def click(self, words, seconds=30):
        until = time.time() + seconds
        while True:
            for button in self.driver.find_elements("tag name", "button"):
                try:
                    if words in button.text and button.is_enabled():
                        self.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", button)
                        button.click()
                        self.clicks += 1
                        return
                except Exception:  # drawn anew in between
                    break
            assert time.time() < until, f"no button {words!r} in:\n{self.text}"
            time.sleep(0.1)

    def fits(self, name):
        """Nothing scrolls sideways at either size; pictures are kept."""
        for width, height in SIZES:
            self._resized(width, height)
            time.sleep(0.5)
            across, inner, down = self.driver.execute_script(
                "const page = document.documentElement; return [page.scrollWidth, window.innerWidth, page.scrollHeight]"
            )
            assert across <= inner, f"step {name} scrolls sideways at {width} pixels"
            folder = os.environ.get("GREYBOX_PICTURES")
            if folder:
                Path(folder).mkdir(parents=True, exist_ok=True)
                self._resized(width, max(height, min(down, 3000)))
                time.sleep(0.4)
                self.driver.save_screenshot(str(Path(folder) / f"{width}_{name}.png"))
        self._resized(*SIZES[0])
        logged = [each["message"] for each in self.driver.get_log("browser") if each["level"] == "SEVERE"]
        errors = [message for message in logged if "favicon" not in message]
        assert errors == []

    def _resized(self, width, height):
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


@pytest.fixture
def server(tmp_path):
    """The page in a process of its own."""
    code = "from greybox_id.cli import main; main()"
    known = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "NICEGUI"))}
    environment = known | {"PYTHONPATH": str(Path(gb.__file__).parents[1])}
    command = [sys.executable, "-c", code, "app", "--no-browser", "--json"]
    process = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True)
    lines = ""
    while "}" not in lines:
        lines += process.stdout.readline()
    yield process, json.loads(lines)
    process.terminate()
    process.wait(20)


@pytest.fixture
def reader():
    """Chromium that no name outside this machine means anything to."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None or shutil.which("chromedriver") is None:
        pytest.skip("There is no Chromium with its driver here: apt-get install chromium chromium-driver.")
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for word in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars",
                 "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"):  # fmt: skip
        options.add_argument(word)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    service = webdriver.ChromeService(shutil.which("chromedriver"))
    driver = webdriver.Chrome(options=options, service=service)
    yield Reader(driver)
    driver.quit()


def test_from_the_drop_to_the_report_without_typing(server, reader):
    process, page = server
    began = time.time()
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
    reader.driver.refresh()  # in the middle of it: the fit is found again
    reader.see("Errors on what was held out")
    reader.fits("5_fit")
    reader.click("Why not better?")
    reader.click("Diagnose the fit")
    reader.see("What could not have been seen")
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
    assert time.time() - began < MOST_SECONDS
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
    reader.driver.find_element("css selector", "input[type=file]").send_keys(str(file))
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
    reader.click("Negate yaw_rate")
    reader.see("Can be used")
    reader.see("✓ Negate yaw_rate")
    reader.fits("3_mended")
