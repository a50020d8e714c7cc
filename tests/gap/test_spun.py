"""Rows in which the vehicle spins: a diagnosis leaves them out, on held-out recordings too, and says so."""

from dataclasses import dataclass, field

import numpy as np

from greybox_id.datasets.recording import Recording
from greybox_id.gap import diagnosis


@dataclass(frozen=True)
class Answer:
    doubts: tuple = ()
    closed: object = None
    held_out: tuple = field(default=())


def test_rows_of_a_spin_are_left_out_and_named(monkeypatch):
    time = np.arange(0.0, 20.0, 0.01)
    sideways = np.where((time > 8.0) & (time < 9.0), 6.0, 0.0)
    spun = Recording("spun", time, {"v_x": np.full(len(time), 4.0), "v_y": sideways, "yaw_rate": np.zeros(len(time))})
    calm = spun.with_signals(v_y=np.zeros(len(time)))
    examined = {}

    def examine(model, recordings, effects, vehicle, tell):
        examined["recordings"] = recordings
        return type("Examined", (), {"recordings": recordings})()

    def answer(result, held_out, tell):
        return Answer(("doubted before",), None, tuple(held_out))

    monkeypatch.setattr(diagnosis, "examine", examine)
    monkeypatch.setattr(diagnosis, "answer", answer)
    gap = diagnosis.diagnose(None, [spun, calm], {}, held_out=[spun])
    left, whole = examined["recordings"]
    assert whole is calm
    assert np.all(left["v_y"] == 0.0)
    assert len(left.runs) == 2
    assert np.all(gap.held_out[0]["v_y"] == 0.0)
    first, sentence = gap.doubts
    assert first == "doubted before"
    assert sentence.startswith("spun: the vehicle spins from t = 8.010 to ")
