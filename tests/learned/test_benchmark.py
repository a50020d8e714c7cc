"""The comparison of black box and name: the truth foretells the vehicle, and what is done is not done again."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def run(*options):
    command = [sys.executable, str(ROOT / "benchmarks" / "loop.py"), "--json", *map(str, options)]
    found = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, "GREYBOX_COMPILE": "0"}
    )
    return found.returncode, found.stdout, found.stderr


@pytest.mark.slow
def test_a_case_is_compared_and_goes_on_where_it_was_stopped(tmp_path):
    options = ("--cases", 1, "--seed", 5, "--rows", 600, "--out", tmp_path / "loop.jsonl", "--arms")
    code, first, _ = run(*options, "oracle")
    assert code == 0
    code, second, said = run(*options, "base", "oracle")
    assert code == 0
    assert "oracle" not in said
    arms = json.loads(second)["600"]["arms"]
    assert arms["oracle"] == json.loads(first)["600"]["arms"]["oracle"]
    for share in ("60%", "90%"):  # of a vehicle with the models' forms the truth foretells all
        for horizon in ("0.1", "0.5", "2.0"):
            assert arms["oracle"]["yaw_rate_rms"][share][horizon] < 1e-3
            assert arms["base"]["yaw_rate_rms"][share][horizon] > 0.05
    assert run("--report", tmp_path / "loop.jsonl")[1] == second


def test_a_report_of_nothing_is_refused(tmp_path):
    code, _, said = run("--report", tmp_path / "nothing.jsonl")
    assert code == 2
    assert "is not there" in said
