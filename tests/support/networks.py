"""Files written by nnodely, what nnodely predicts with them, and the same files changed by hand."""

import copy
import json
from pathlib import Path

import numpy as np

from greybox_id.datasets.recording import Recording
from greybox_id.fitting.scores.memory import predictions
from greybox_lab.nnodely import import_network

FOLDER = Path(__file__).parents[1] / "lab" / "nnodely" / "nnodely"
NAMES = ("lat", "lat_small", "lat_without_a_x", "renamed", "long", "long_by_axle", "full", "full_closed")
FOREIGN = ("v_x=omega_rear", "steer=handwheel", "a_x=imu_long")
"""Which signals the inputs of `renamed` are."""


def said(name: str) -> tuple[str, ...]:
    return FOREIGN if name == "renamed" else ()


def body_of(name: str) -> dict:
    """A file's content, to be changed."""
    return copy.deepcopy(json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8")))


def stated(name: str) -> dict:
    """Random windows and nnodely's predictions."""
    return json.loads((FOLDER / f"{name}.windows.json").read_text(encoding="utf-8"))


def written(tmp_path: Path, body: object) -> Path:
    """A file with another content; a text is written as it is."""
    file = tmp_path / "net.json"
    file.write_text(body if isinstance(body, str) else json.dumps(body), encoding="utf-8")
    return file


def imported(tmp_path: Path, body: object, inputs=(), sample_time=None):
    return import_network(written(tmp_path, body), inputs, sample_time)


def predicted(model, windows: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """One sample ahead from windows (windows, samples) of each signal, by output."""
    count, length = next(iter(windows.values())).shape
    stretched = {name: np.pad(values, ((0, 0), (0, 1))).ravel() for name, values in windows.items()}
    missing = {name: np.zeros(count * (length + 1)) for name in (*model.inputs, *model.outputs) if name not in windows}
    runs = tuple((k * (length + 1), (k + 1) * (length + 1)) for k in range(count))
    time = np.tile(np.arange(length + 1) * model.sample_time, count)
    found = predictions(model, Recording("windows", time, stretched | missing, runs=runs)).predicted
    last = found.reshape(count, -1, len(model.outputs))[:, -1]  # windows longer than the model's give earlier rows too
    return dict(zip(model.outputs, last.T, strict=True))
