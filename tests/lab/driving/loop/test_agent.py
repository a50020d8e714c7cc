"""A vehicle's side of the loop: it drives, sends rows, and lets no policy drive that the twin speaks against."""

import json
import signal
import subprocess
import sys
import time

import pytest
from calling import greybox, refused
from serving import START, serving

from greybox_lab.driving.loop import agent as room
from greybox_lab.driving.loop import demo
from greybox_lab.driving.loop.agent import agent
from greybox_lab.driving.loop.client import Unanswered
from greybox_lab.driving.loop.protocol import digest_of
from greybox_lab.driving.loop.scene import Scene
from greybox_lab.driving.racing.learner import shipped_learned

TOKEN = b"a token that is long enough"


class Canned:
    """A server that answers as it is told, and remembers what it was asked."""

    def __init__(self, result, silent=0):
        self.result, self.silent, self.asked, self.body = result, silent, [], shipped_learned().text().encode()

    def post(self, path, body):
        self.asked.append((path, body))
        if self.silent and path.endswith("/rows"):
            self.silent -= 1
            raise Unanswered("nobody")
        if path.endswith("/train"):
            return {"id": "a" * 16, "status": "training", "sentence": "", "result": {}}
        return {}

    def get(self, path):
        said = [{"cap": cap, "path_error_rms": cap / 20, "worst": 0.05} for cap in (0.48, 0.6, 0.66)]
        done = {
            "foretold": said,
            "vehicle": Scene(0).text,
            "named": [],
            "applied": {},
            "policy": digest_of(self.body),
            **self.result,
        }
        return {"id": "a" * 16, "status": "done", "sentence": "", "result": done}

    def policy(self, sha):
        assert sha == digest_of(self.body)
        return self.body

    def rows(self):
        return [body for path, body in self.asked if path.endswith("/rows")]


@pytest.fixture
def _small(monkeypatch):
    for name, value in (("ROWS", 300), ("BASE", 1), ("POLL", 0.01), ("LEAST", 10**6)):
        monkeypatch.setattr(room, name, value)
    monkeypatch.setattr(demo, "used_to", lambda *_: shipped_learned())
    monkeypatch.setattr(room, "rows_due", lambda rows, first: "it is time" if rows >= 600 else "")


def driven_with(canned, folder, monkeypatch, **options):
    monkeypatch.setattr(room, "Client", lambda *_: canned)
    return agent("http://nobody", TOKEN, folder, trainings=1, **options)


@pytest.mark.slow
@pytest.mark.usefixtures("_small")
@pytest.mark.parametrize(
    ("result", "refused_because"),
    [
        ({"crashes": 0, "path_error": 0.02, "path_error_before": 0.03}, ""),
        ({"crashes": 2, "path_error": 0.02, "path_error_before": 0.03}, "2 vehicles crash"),
        (
            {"crashes": 0, "path_error": 0.04, "path_error_before": 0.03},
            "0.040 m with the new policy, 0.030 m with the present one",
        ),
    ],
    ids=["better", "crashes", "worse"],
)
def test_a_policy_drives_where_the_twin_says_nothing_against_it(result, refused_because, tmp_path, monkeypatch):
    canned = Canned(result)
    found = driven_with(canned, tmp_path / "car", monkeypatch)
    (training,) = found.body["trainings"]
    assert refused_because in training["refused"]
    assert bool(training["refused"]) == bool(refused_because)
    assert [drive["rows"] for drive in found.body["drives"]] == [300, 300, 300]
    if not refused_because:
        last = found.body["drives"][-1]
        assert last["path_error_foretold"] == pytest.approx({0.48: 0.024, 0.6: 0.03}[round(last["cap"], 2)])
    assert training["reason"] == "it is time"
    assert canned.rows() == [(tmp_path / "car" / "rows" / f"rows_00000{k}.csv").read_bytes() for k in (1, 2, 3)]
    kinds = [json.loads(line)["kind"] for line in (tmp_path / "car" / "log.jsonl").read_text().splitlines()]
    assert kinds.count("swap") == (not refused_because)
    assert found.body["withheld"] == Scene(0).effects
    asked = len(canned.asked)
    assert (
        driven_with(canned, tmp_path / "car", monkeypatch).body["trainings"] == found.body["trainings"]
    )  # nothing is learned again
    assert not [path for path, _ in canned.asked[asked:] if path.endswith("/train")]


@pytest.mark.slow
@pytest.mark.usefixtures("_small")
def test_rows_wait_while_nobody_answers_and_a_server_that_is_silent_for_a_moment_is_asked_again(tmp_path, monkeypatch):
    canned = Canned({"crashes": 0, "path_error": 0.02, "path_error_before": 0.03}, silent=3)
    assert len(driven_with(canned, tmp_path / "car", monkeypatch).body["drives"]) == 3
    first, second, third = ((tmp_path / "car" / "rows" / f"rows_00000{k}.csv").read_bytes() for k in (1, 2, 3))
    # after each of two drives, when it is time to learn, and half a second later
    assert canned.rows() == [first, first, first, first, second, third]
    kinds = [json.loads(line)["kind"] for line in (tmp_path / "car" / "log.jsonl").read_text().splitlines()]
    assert kinds.count("rows wait") == 2
    monkeypatch.setattr(room, "PATIENCE", 0.0)
    with pytest.raises(Unanswered):
        driven_with(Canned({}, silent=10**6), tmp_path / "other", monkeypatch)


def test_what_is_wrong_is_a_sentence(tmp_path):
    (tmp_path / "token.txt").write_bytes(TOKEN)
    call = ("loop", "agent", "http://127.0.0.1:1", "--token-file", tmp_path / "token.txt")
    assert "does not answer" in refused(*call, "--out", tmp_path / "car")
    assert "holds something else" in refused(*call, "--out", tmp_path)
    assert "is no address" in refused("loop", "agent", "car", *call[3:], "--out", tmp_path / "car2")
    assert "token file" in refused(*call[:4], tmp_path / "none.txt", "--out", tmp_path / "car3")


@pytest.mark.examination
@pytest.mark.slow
def test_an_agent_that_a_kill_interrupts_carries_on_and_drives_better(tmp_path):
    with serving(tmp_path) as server:
        call = ["loop", "agent", server.address, "--token-file", str(tmp_path / "token.txt"), "--out"]
        call += [str(tmp_path / "car"), "--case", "1", "--trainings", "1", "--steps", "60000", "--json"]
        process = subprocess.Popen(
            [sys.executable, "-c", START.format(sys.path), *call], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        while not (tmp_path / "car" / "rows" / "rows_000001.csv").exists():
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGKILL)
        process.wait()
        called = greybox(*call)
        assert called.code == 0, called.err
        found = json.loads(called.out)
    (training,) = found["trainings"]
    assert training["refused"] == ""
    there = Scene(1).effects
    assert set(training["applied"]) <= set(there)  # one gentle lap tells the lag, and does not always tell grip
    assert training["applied"]["steering_lag"] == pytest.approx(there["steering_lag"], rel=0.1)
    assert found["drives"][-1]["path_error_rms"] < 0.85 * found["drives"][0]["path_error_rms"]
