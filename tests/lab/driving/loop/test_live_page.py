"""The live page shows in a browser what happens: telemetry, triggers, diagnoses and swaps."""

import json
import os
import shlex
import shutil
import subprocess
import time
from contextlib import contextmanager

import pytest
from serving import serving

from greybox_lab.driving.loop.scene import Scene
from greybox_lab.driving.racing.learner import shipped_learned

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
QUIET = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --disable-default-apps"
)
NOWHERE = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"


class Page:
    """A page in a browser, asked through the pipes of its debugger: what is streamed comes after a page is loaded."""

    def __init__(self, to, answers):
        self._to, self._answers, self._count, self._session = to, answers, 0, {}

    def ask(self, method, **parameters):
        """What the browser answers."""
        self._count += 1
        asked = {"id": self._count, "method": method, "params": parameters, **self._session}
        self._to.write(json.dumps(asked).encode() + b"\0")
        self._to.flush()
        while True:
            text = b""
            while not text.endswith(b"\0"):
                text += self._answers.read(1)
            said = json.loads(text[:-1])
            if said.get("id") == self._count:
                return said["result"]

    def opened(self, address):
        """The page at an address."""
        target = self.ask("Target.createTarget", url=address)["targetId"]
        found = self.ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": found["sessionId"]}
        return self

    def shown(self):
        """The page as it is now."""
        html = (
            "document.documentElement ? document.documentElement.outerHTML : ''"  # none while a page is being replaced
        )
        return self.ask("Runtime.evaluate", expression=html)["result"].get("value", "")


@contextmanager
def browser(folder):
    read, to = os.pipe()
    answers, write = os.pipe()
    call = [CHROMIUM, *QUIET.split(), NOWHERE, f"--user-data-dir={folder / 'profile'}", "--remote-debugging-pipe"]
    line = f"exec {shlex.join(call)} 3<&{read} 4>&{write}"
    process = subprocess.Popen(
        ["bash", "-c", line], pass_fds=(read, write), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    os.close(read)
    os.close(write)
    try:
        with open(to, "wb") as asks, open(answers, "rb") as told:
            yield Page(asks, told)
    finally:
        process.kill()
        process.wait()


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine: the live page was not opened in a browser")
def test_a_browser_shows_what_happens(tmp_path):
    with serving(tmp_path) as own:
        sha = own.client.post("/v1/policies", shipped_learned().text().encode())["sha256"]
        own.client.post("/v1/hello", {"session": "car", "vehicle": Scene(0).text, "policy": sha})
        telemetry = [{"kind": "telemetry", "v_x": 3.25, "e_y": 0.125, "cap": 0.66, "policy": sha}] * 40
        more = [
            {"kind": "trigger", "reason": "path error <b>0.1</b> m"},
            {"kind": "swap", "reason": "", "sha256": sha},
            {"kind": "envelope", "reason": "0.90 m from the path"},
        ]
        own.client.post("/v1/sessions/car/events", {"events": telemetry + more})
        with browser(tmp_path) as opened:
            page, until = opened.opened(own.address), time.monotonic() + 60.0
            while "0.90 m" not in (shown := page.shown()) and time.monotonic() < until:
                time.sleep(0.2)
    assert '<small id="link">connected</small>' in shown
    assert f"car: 3.25 m/s, 0.125 m from the path, policy {sha[:8]}, cap 0.66" in shown
    triggers, rest = shown.split('id="triggers"')[1].split("</table>", 1)
    assert "path error &lt;b&gt;0.1&lt;/b&gt; m" in triggers  # text, never markup
    swaps = rest.split('id="swaps"')[1].split("</table>")[0]
    assert sha in swaps
    assert "0.90 m from the path" in swaps
