"""Chromium, and the page in a process of its own."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

import greybox_id as gb

SIZES = ((1280, 800), (1920, 1080))
SHOWN = """
const [selector, words, whole] = arguments;
return [...document.querySelectorAll(selector)].filter(each => each.getClientRects().length && !each.disabled
  && (whole ? each.innerText.trim() === words : each.innerText.includes(words)));
"""


class Reader:
    """Who looks at the page and clicks."""

    def __init__(self, driver):
        self.driver, self.clicks = driver, 0

    @property
    def text(self):
        return self.driver.execute_script("return document.body.innerText")

    def see(self, words, seconds=240):
        self.wait(lambda: words in self.text, repr(words), seconds)

    def wait(self, condition, words, seconds=240):
        """Look again and again, at most a twentieth later than it is there: a look costs the page a layout."""
        began = time.time()
        while not condition():
            waited = time.time() - began
            assert waited < seconds, f"{words} is not seen in:\n{self.text}"
            time.sleep(min(max(0.1, waited / 20), 2.0))

    def drop(self, *files):
        self.see("Drop recordings")
        self.driver.find_element("css selector", "input[type=file]").send_keys("\n".join(map(str, files)))

    def shown(self, selector, words="", whole=False):
        """Elements that are seen and hold some words, looked for in one step: a page may be drawn anew in between."""
        return self.driver.execute_script(SHOWN, selector, words, whole)

    def pick(self, label, option, which=0):
        self.press(lambda: self.shown(".q-select", label)[which:], f"no choice {label!r}")
        self.wait(lambda: self.shown(".q-menu .q-item", option, True), f"the option {option}", 60)
        self.shown(".q-menu .q-item", option, True)[0].click()
        self.wait(lambda: not self.shown(".q-menu .q-item"), f"no menu after {option} was picked", 60)
        self.clicks += 2

    def click(self, words, seconds=240):
        self.press(lambda: self.shown("button", words), f"no button {words!r}", seconds)
        self.clicks += 1

    def press(self, found, missing, seconds=240):
        """Click the first of what is found, as soon as it stands still."""
        until, trouble = time.time() + seconds, ""
        while time.time() < until:
            try:
                for element in found()[:1]:
                    self.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
                    element.click()
                    return
            except Exception as error:  # drawn anew in between
                trouble = f"{error} "
            time.sleep(0.1)
        raise AssertionError(f"{missing}: {trouble}in:\n{self.text}")

    def fits(self, name):
        """Nothing scrolls sideways at either size; pictures are kept."""
        for width, height in SIZES:
            self.resize(width, height)
            time.sleep(0.5)
            across, inner, down = self.driver.execute_script(
                "const page = document.documentElement; return [page.scrollWidth, window.innerWidth, page.scrollHeight]"
            )
            assert across <= inner, f"step {name} scrolls sideways at {width} pixels"
            folder = os.environ.get("GREYBOX_PICTURES")
            if folder:
                Path(folder).mkdir(parents=True, exist_ok=True)
                self.resize(width, max(height, min(down, 3000)))
                time.sleep(0.4)
                self.driver.save_screenshot(str(Path(folder) / f"{width}_{name}.png"))
        self.resize(*SIZES[0])
        logged = [each["message"] for each in self.driver.get_log("browser") if each["level"] == "SEVERE"]
        errors = [message for message in logged if "favicon" not in message]
        assert errors == []

    def resize(self, width, height):
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


@pytest.fixture
def start(tmp_path):
    """Starts the page in a process of its own; what it printed."""
    code = "from greybox_id.cli import main; main()"
    foreign = ("PYTEST", "NICEGUI", "GREYBOX_COMPILE")  # the page is as its reader has it, whatever fixtures are up
    known = {name: value for name, value in os.environ.items() if not name.startswith(foreign)}
    environment = known | {"PYTHONPATH": str(Path(gb.__file__).parents[1])}
    command = [sys.executable, "-c", code, "app", "--no-browser", "--json"]
    processes = []

    def started():
        process = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True)
        processes.append(process)
        lines = ""
        while "}" not in lines:
            lines += process.stdout.readline()
        return process, json.loads(lines)

    yield started
    for process in processes:
        process.terminate()
        process.wait(20)


@pytest.fixture
def server(start):
    """The page in a process of its own."""
    return start()


@pytest.fixture
def reader():
    """Chromium that no name outside this machine means anything to."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None or shutil.which("chromedriver") is None:
        pytest.skip("There is no Chromium with its driver here: apt-get install chromium chromium-driver.")
    webdriver = pytest.importorskip("selenium.webdriver", reason="Selenium drives the browser: pip install selenium.")
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for word in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars",
                 "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"):  # fmt: skip
        options.add_argument(word)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    service = webdriver.ChromeService(shutil.which("chromedriver"))
    driver = webdriver.Chrome(options=options, service=service)
    reader = Reader(driver)
    reader.resize(*SIZES[0])
    yield reader
    driver.quit()
