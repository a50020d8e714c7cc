"""What reaches a terminal is text; standard output that is full or closed ends in a sentence or in silence."""

import json
import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from calling import greybox

import greybox_id
from greybox_id.cli.terminal import clean, clean_json

CLI = Path(greybox_id.__file__).parent / "cli"
ESC = "\x1b[31;1mred\x1b]0;title\x07\x9b2J\u202eright"
ORDERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e]")


@pytest.fixture
def lap(tmp_path):
    file = tmp_path / f"lap{ESC}.csv"
    table = {"time": [0.0, 0.1, 0.2, 0.3], f"v{ESC} [m/s{ESC}]": [1.0, 2.0, 3.0, 4.0], "v_x": [1.0, 1.1, 1.2, 1.3]}
    pd.DataFrame(table).to_csv(file, index=False)
    return file


@pytest.mark.parametrize(
    "words",
    [
        ["data", "map", "{lap}"], ["data", "map", "{lap}", "--json"], ["data", "check", "{lap}"],
        ["data", "check", "{lap}", "--json"], ["data", "convert", "{lap}", "--out", "{lap}.csv"],
        ["data", "check", "{lap}x"], ["data", "check", "{lap}", "--columns", ESC], ["models", ESC], [ESC],
        ["data", ESC], ["data", "check", f"--{ESC}"], ["fit", "{lap}", "--model", ESC], ["effects", ESC],
        ["fit", "{lap}", "--model", "lateral", "--fix", f"m={ESC}"], ["fit", "{lap}", "--model", "lateral"],
        ["export", "--vehicle", ESC, "--target", ESC, "--out", ESC], ["datasets", "fetch", ESC],
        ["simulate", "{lap}", "--vehicle", "roboracer", "--start-state", f"{ESC}=1"], ["import", "{lap}"],
        ["gap", "{lap}", "--vehicle", ESC], ["report", "{lap}"], ["validate", "{lap}", "{lap}"],
    ],
)  # fmt: skip
def test_no_command_hands_orders_of_a_name_to_the_terminal(words, lap):
    called = greybox(*(word.replace("{lap}", str(lap)) for word in words))
    assert "Traceback" not in called.err
    assert not ORDERS.search(called.out)
    assert not ORDERS.search(called.err)
    assert called.out + called.err


def test_escaped_json_is_the_same_json():
    body = {"name": ESC}
    text = clean_json(json.dumps(body, ensure_ascii=False))
    assert not ORDERS.search(text)
    assert json.loads(text) == body
    assert clean("a\tb\n") == "a\tb\n"


def test_nothing_prints_but_through_the_one_place():
    for file in CLI.glob("*.py"):
        text = file.read_text("utf-8")
        if file.name != "terminal.py":
            assert "click.echo" not in text, file.name
            assert "Console(" not in text, file.name
            assert not re.search(r"(?<![\w.])print\(", text), file.name


def test_what_the_toolbox_warns_of_is_a_sentence_on_standard_error(monkeypatch):
    monkeypatch.setattr("greybox_id.cli.greybox", lambda **_: logging.getLogger("greybox_id").warning("slow%s", "\x1b"))
    assert greybox("models").err == "warning: slow␛\n"


@pytest.mark.parametrize(("interrupted", "code"), [(True, 130), (False, 1)])
def test_an_error_a_library_makes_of_an_interrupt_is_an_interrupt(interrupted, code):
    raised = "signal.raise_signal(signal.SIGINT)" if interrupted else "raise KeyError"
    called = (
        "import signal, greybox_id.cli as cli\n"
        "def imported(**_):\n"
        f"    try: {raised}\n"
        "    except BaseException: raise ImportError('initialization failed') from None\n"
        "cli.greybox = imported\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "cli.main()"
    )
    done = subprocess.run([sys.executable, "-c", called], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == code
    assert done.stderr.endswith("greybox: interrupted\n" if interrupted else "ImportError: initialization failed\n")


def called(command):
    line = f'"{sys.executable}" -c "from greybox_id.cli import main; main()" {command}'
    return subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=False)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full here")
@pytest.mark.parametrize("command", ["models", "models --json", "effects", "datasets list", "completion bash"])
def test_a_full_standard_output_is_told(command):
    done = called(f"{command} > /dev/full")
    assert (done.returncode, done.stderr) == (
        2,
        "greybox: standard output cannot be written: No space left on device.\n",
    )


@pytest.mark.slow
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", ">&- 2>&- <&-"])
def test_closed_streams_change_nothing_that_is_written(closed, tmp_path):
    done = called(f"datasets make virtual_lap --seed 1 --out {tmp_path} {closed}")
    assert (done.returncode, done.stderr) == (0, "")
    assert called(f"datasets make virtual_lap --seed 1 --out {tmp_path}").returncode == 0  # the same bytes


def test_a_reader_that_has_seen_enough_ends_it_quietly():
    done = called("effects --json | head -c 1")
    assert (done.returncode, done.stdout, done.stderr) == (0, "{", "")
