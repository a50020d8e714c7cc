"""Whatever a policy does, commands stay within limits; a vehicle that is not driven as foretold is driven slower."""

import json

import numpy as np
import pytest

from greybox_lab.driving.loop.safety import Cap, CommandLimits, Envelope, Log
from greybox_lab.driving.loop.triggers import path_error_beyond, rows_due

PERIOD = 0.02


def test_commands_are_limited_in_size_and_rate_and_never_no_number():
    limits = CommandLimits(np.array([-0.4, -2.0]), np.array([0.4, 1.0]), np.array([2.0, 10.0]), PERIOD)
    generator, before = np.random.default_rng(0), np.zeros(2)
    for k in range(2000):
        wanted = 3.0 * generator.standard_normal(2)
        if k % 10 == 0:
            wanted[k // 10 % 2] = (np.nan, np.inf)[k // 20 % 2]
        given = limits(wanted)
        assert np.all(np.isfinite(given))
        assert np.all(np.abs(given - before) <= np.array([0.04, 0.2]) + 1e-12)
        assert np.all((given >= [-0.4, -2.0]) & (given <= [0.4, 1.0]))
        before = given


def test_the_envelope_is_left_beside_the_path_and_by_more_error_than_foretold():
    envelope = Envelope(1.0, 0.05, PERIOD)
    assert not envelope.left(0.79)
    assert "from the path" in envelope.left(0.81)
    envelope.begin()
    said = [envelope.left(0.08) for _ in range(150)]
    assert said[98] == ""
    assert "predicted" in said[99]
    envelope.begin(0.06)
    assert not any(envelope.left(0.08) for _ in range(150))


def test_the_cap_rises_slowly_and_falls_fast():
    cap = Cap(0.6)
    cap.clean = 2
    assert not cap.next_cycle()
    cap.clean = 3
    assert cap.next_cycle()
    assert cap.share == pytest.approx(0.66)
    assert not cap.next_cycle()
    cap.event()
    assert cap.share == pytest.approx(0.528)
    for _ in range(20):
        cap.event()
    assert cap.share == 0.4
    for _ in range(20):
        cap.clean = 3
        cap.next_cycle()
    assert cap.share == 0.9


def test_a_line_of_the_log_that_a_kill_cut_short_is_gone(tmp_path):
    log = Log(tmp_path / "log.jsonl")
    log.write("swap", sha256="a", lap=float("nan"))
    with (tmp_path / "log.jsonl").open("a") as file:
        file.write('{"kind": "cra')
    Log(tmp_path / "log.jsonl").write("crash")
    kinds = [json.loads(line)["kind"] for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert kinds == ["swap", "crash"]


def test_it_is_time_by_counts_as_published_and_by_evidence():
    for first, least in ((True, 5_000), (False, 10_000)):
        assert not rows_due(least - 1, first=first)
        assert rows_due(least, first=first)
    assert path_error_beyond(0.16, 0.1)
    assert not path_error_beyond(0.14, 0.1)
