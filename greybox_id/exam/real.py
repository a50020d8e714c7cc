"""Cases of real recordings: after a change that only the file's name tells, or altered exactly beside a null.

What the vehicle did is real. Where a recording is altered after the fact as an effect would have altered it, what is
withheld is known: a command that acts late was given earlier, a sensor that reads too much has its readings scaled. The
model is fitted to a stretch before, which is handed out as well: what is said of an altered window is to be what
differs from there.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from ..datasets.read import read
from ..datasets.vehicle_file import vehicle
from ..errors import BadInput
from ..files import write_atomically
from ..fit import KIND
from ..fitting import Say, fit
from ..models.registry import build
from ..recording import Recording
from ..shorthands import Array
from .answers import Answer, write_answer
from .folder import BEFORE, CASES, COLUMNS, SEALED
from .make import Exam, finish, prepare, write_recording

CHANGED = {"tire_set_1.csv": "other tyres", "single_mass.csv": "a mass added"}
"""Recording -> what its name says; more is not known."""
TRAINED = "train.csv"
ROBORACER = "roboracer"
"""Column map, and vehicle, of these recordings."""


def make_real(folder: Path, data: Path, say: Say) -> Exam:
    """Cases of the RoboRacer recordings; what was fitted before the change is the model.

    Parameters
    ----------
    folder : to be made, or empty.
    data : folder with the recordings, or that holds a folder roboracer with them.
    say : told of progress.

    Raises
    ------
    BadInput : a recording is missing, or the folder is not empty.
    """
    source = data / ROBORACER if (data / ROBORACER).is_dir() else data
    if lacking := [name for name in (TRAINED, *CHANGED) if not (source / name).is_file()]:
        raise BadInput(f"{source} holds no {', '.join(lacking)}; name the folder of the RoboRacer recordings.")
    prepare(folder)
    before = fit(build("single_track", vehicle=vehicle(ROBORACER)), [read(source / TRAINED, ROBORACER)], say=say)
    columns = resources.files("greybox_id.datasets").joinpath("columns", f"{ROBORACER}.toml").read_text("utf-8")
    answers = []
    for number, (name, about) in enumerate(CHANGED.items()):
        case = f"case_{number:03d}"
        before.save(folder / CASES / case / "fit.json")
        write_atomically(folder / CASES / case / COLUMNS, columns)
        shutil.copyfile(source / name, folder / CASES / case / "recording.csv")
        answer = Answer(case, "real", "real", {}, about={"file": name, "says": about})
        write_answer(answer, folder / SEALED / case / "answer.json")
        answers.append(answer)
    return finish(folder, "real", 0, answers)


WINDOW, FIRST = 40.0, 80.0
"""Of a case, and of the stretch before that the model is fitted to, s."""
LEAST_SPEED = 0.15
"""Share of the recording's highest speed that a window's mean must exceed: at rest nothing shows."""
TRIES = 200


@dataclass(frozen=True)
class InjectedSource:
    """Real recordings of a vehicle.

    Attributes
    ----------
    files : below the folder of data; windows are of the last one, the model is fitted to the first.
    columns, vehicle, model : column map, shipped vehicle, and model that is fitted.
    """

    files: tuple[str, ...]
    columns: str
    vehicle: str
    model: str


SOURCES: Mapping[str, InjectedSource] = {
    "roboracer": InjectedSource(
        ("roboracer/train.csv", "roboracer/valid.csv"), "roboracer", "roboracer", "single_track"
    ),
    "ferrari": InjectedSource(("revs_250lm/run1_first400s.csv.gz",), "revs_250lm", "ferrari_250lm", "lateral"),
    "truck": InjectedSource(("truck/train.parquet", "truck/val.parquet"), "truck", "truck", "lateral"),
}

Alter = Callable[[Recording, float], Mapping[str, Array]]


def _later(recording: Recording, name: str, seconds: float) -> Array:
    """A signal so many seconds before each row; negative: after. The ends repeat."""
    at = recording.time - seconds
    return np.asarray(np.interp(at, recording.time, recording[name]))


def _late(*names: str) -> Alter:
    return lambda r, x: {name: _later(r, name, x) for name in names if name in r}


def _scaled(name: str) -> Alter:
    return lambda r, x: {name: r[name] * x}


def _raised(name: str) -> Alter:
    return lambda r, x: {name: r[name] + x}


def _turned(r: Recording, x: float) -> Mapping[str, Array]:
    c, s = np.cos(x), np.sin(x)
    return {"a_x": c * r["a_x"] + s * r["a_y"], "a_y": c * r["a_y"] - s * r["a_x"]}


@dataclass(frozen=True)
class Injection:
    """How a recording is altered.

    Attributes
    ----------
    alter : recording, magnitude -> the signals that become others.
    null, low, high : the magnitude at which nothing changes, and how far from it others lie.
    sides : whether below the null as well.
    needs : signals.
    outputs : whether one of these must be an output of the model; a command is always read.
    """

    alter: Alter
    null: float
    low: float
    high: float
    sides: bool
    needs: tuple[str, ...]
    outputs: bool = True


INJECTIONS: Mapping[str, Injection] = {
    "steering_delay": Injection(lambda r, x: {"steer": _later(r, "steer", -x)}, 0.0, 0.04, 0.10, False, ("steer",),
                                False),
    "steering_ratio": Injection(lambda r, x: {"steer": r["steer"] / x}, 1.0, 0.10, 0.18, True, ("steer",), False),
    "steering_offset": Injection(lambda r, x: {"steer": r["steer"] - x}, 0.0, 0.012, 0.03, True, ("steer",), False),
    "yaw_rate_scale": Injection(_scaled("yaw_rate"), 1.0, 0.05, 0.12, True, ("yaw_rate",)),
    "yaw_rate_bias": Injection(_raised("yaw_rate"), 0.0, 0.03, 0.10, True, ("yaw_rate",)),
    "sensor_latency_yaw": Injection(_late("yaw_rate"), 0.0, 0.03, 0.10, False, ("yaw_rate",)),
    "sensor_latency_imu": Injection(_late("yaw_rate", "a_x", "a_y"), 0.0, 0.03, 0.10, False, ("a_x", "a_y")),
    "accel_bias_y": Injection(_raised("a_y"), 0.0, 0.4, 1.2, True, ("a_y",)),
    "imu_mount_yaw": Injection(_turned, 0.0, 0.08, 0.25, True, ("a_x", "a_y")),
    "velocity_lever_arm": Injection(lambda r, x: {"v_y": r["v_y"] + x * r["yaw_rate"]}, 0.0, 0.6, 2.0, True,
                                    ("v_y", "yaw_rate")),
}  # fmt: skip
"""Every magnitude lies at twice the scatter between unchanged runs of one real car (DART: ratio 4 %, offset 5.5 mrad,
delay and lag 13 ms) or further off, up to five times."""


def make_injected(folder: Path, data: Path, seed: int, singles: int, say: Say) -> Exam:
    """Cases of altered real recordings, and the windows unaltered.

    Parameters
    ----------
    folder : to be made, or empty.
    data : folder with the folders of recordings; sources that are not there are passed over.
    seed : draws windows, effects and magnitudes.
    singles : how many altered ones; there are as many nulls.
    say : told of progress.

    Raises
    ------
    BadInput : none of the recordings is there, or the folder is not empty.
    """
    if singles < 1:
        raise BadInput("An examination needs at least one case; ask for some with ‹singles›.")
    there = {name: own for name, own in SOURCES.items() if all((data / file).is_file() for file in own.files)}
    if not there:
        files = ", ".join(file for own in SOURCES.values() for file in own.files)
        raise BadInput(f"{data} holds none of {files}. Name the folder of the recordings with ‹data›.")
    prepare(folder)
    rng = np.random.default_rng((seed, 61031))
    sources = [PreparedCase.of(name, own, data, say) for name, own in there.items()]
    drawn: list[tuple[PreparedCase, Recording, str, float]] = []
    for k in range(singles):
        source = sources[k % len(sources)]
        window, name = source.window(rng), source.effects[int(rng.integers(len(source.effects)))]
        drawn += [(source, window, name, _magnitude(INJECTIONS[name], rng)), (source, window, "", 0.0)]
    answers, digits = [], max(3, len(str(len(drawn))))
    for place, k in enumerate(rng.permutation(len(drawn))):
        source, window, name, x = drawn[k]
        answers.append(_written(folder, f"case_{place:0{digits}d}", source, window, name, x, seed))
    say(f"{len(answers)} cases made")
    return finish(folder, "injected", seed, answers)


def _magnitude(own: Injection, rng: np.random.Generator) -> float:
    size = float(np.exp(rng.uniform(np.log(own.low), np.log(own.high))))
    down = own.sides and rng.random() < 0.5
    if own.null == 1.0:
        return 1.0 / (1.0 + size) if down else 1.0 + size
    return -size if down else size


@dataclass(frozen=True)
class PreparedCase:
    """A source that was read, and the model fitted to its first stretch.

    Attributes
    ----------
    name : of the source.
    before : what the model was fitted to.
    after : whose windows are altered.
    fit : the fit as text.
    effects : that its signals allow.
    """

    name: str
    before: Recording
    after: Recording
    fit: str
    effects: tuple[str, ...]

    @classmethod
    def of(cls, name: str, source: InjectedSource, data: Path, say: Say) -> PreparedCase:
        """Read and fit a source."""
        first = read(data / source.files[0], source.columns)
        last = read(data / source.files[-1], source.columns) if len(source.files) > 1 else first
        rows = round(FIRST / first.sample_time)
        before = first.rows(0, rows)
        after = last if last is not first else first.rows(rows, len(first))
        model = build(source.model, vehicle=vehicle(source.vehicle))
        found = fit(model, [before], say=say)
        outputs = set(model.outputs)
        able = [
            key
            for key, own in INJECTIONS.items()
            if all(signal in after for signal in own.needs) and (not own.outputs or outputs & set(own.needs))
        ]
        return cls(name, before, after, KIND.text(found.as_dict()), tuple(able))

    def window(self, rng: np.random.Generator) -> Recording:
        """A window in motion, within a run where runs are as long.

        Raises
        ------
        BadInput : there is none.
        """
        rows = round(WINDOW / self.after.sample_time)
        v = np.abs(self.after["v_x"])
        if len(v) <= rows:
            return self.after
        for _ in range(TRIES):
            start = int(rng.integers(len(v) - rows))
            if np.mean(v[start : start + rows]) > LEAST_SPEED * np.max(v):
                return self.after.rows(start, start + rows)
        raise BadInput(f"{self.after.name} has no {WINDOW:g} s in motion.")


def altered(window: Recording, name: str, magnitude: float) -> Recording:
    """A recording as an effect would have altered it, run by run."""
    own = INJECTIONS[name]
    parts: dict[str, list[Array]] = {}
    for start, stop in window.runs:
        for signal, values in own.alter(window.rows(start, stop), magnitude).items():
            parts.setdefault(signal, []).append(values)
    return window.with_signals(**{signal: np.concatenate(values) for signal, values in parts.items()})


def _written(
    folder: Path, case: str, source: PreparedCase, window: Recording, name: str, magnitude: float, seed: int
) -> Answer:
    given = folder / CASES / case
    write_recording(altered(window, name, magnitude) if name else window, given / "recording.csv")
    write_recording(source.before, given / BEFORE)
    write_atomically(given / "fit.json", source.fit)
    columns = resources.files("greybox_id.datasets").joinpath("columns", "canonical.toml").read_text("utf-8")
    write_atomically(given / COLUMNS, columns.replace('hold = "zero"', f'hold = "{window.hold}"'))
    answer = Answer(
        case,
        "single" if name else "null",
        "injected",
        {name: magnitude} if name else {},
        {name: INJECTIONS[name].null} if name else {},
        seed=seed,
        about={"source": source.name, "from": float(window.time[0])},
    )
    write_answer(answer, folder / SEALED / case / "answer.json")
    return answer
