"""Public recordings: their authors' addresses and licences, and fetching them, resumed and checked by SHA-256.

Addresses name a commit where one is known: what lies there never changes.
"""

from __future__ import annotations

import http.client
import json
import urllib.error
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pandas as pd

from ..base.errors import BadInput, near_or_all
from ..base.files import cache_folder, replacing, writable, write_atomically
from ..base.guard import permit
from ..base.shorthands import Say
from ..base.version import __version__
from .formats import hash_of


@dataclass(frozen=True)
class Remote:
    """A file at its source.

    Attributes
    ----------
    name : what it is called here.
    address : where it is fetched from.
    sha256 : of its bytes; empty where it is not known. It is then written down at the first fetch and compared later.
    """

    name: str
    address: str
    sha256: str = ""


@dataclass(frozen=True)
class PublicDataset:
    """Recordings of one source.

    Attributes
    ----------
    name : what commands call it.
    about : what was recorded.
    source : the authors' page.
    licence : as the authors state it.
    reference : what to cite.
    columns : the shipped column map that fits; empty where a bench reads the files as they are.
    files : what can be fetched; empty where the files have no known address.
    joined : name of a CSV file whose columns the files are, one each; empty where each is a recording.
    """

    name: str
    about: str
    source: str
    licence: str
    reference: str
    columns: str
    files: tuple[Remote, ...] = field(default=())
    joined: str = ""


_ROBORACER = (
    "https://raw.githubusercontent.com/tonegas/nnodely-applications/ba4e6e4e3125192a37b55eeb90c93112176abbe1/"
    "vehicle/model_combined_vehicle_dynamics_RoboRacer/Dataset/"
)
_APPLICATIONS = "https://raw.githubusercontent.com/tonegas/nnodely-applications/main/vehicle/"
_REVS = (
    "https://raw.githubusercontent.com/MBDS/sideslip-angle-vehicle-estimation/"
    "2a427a76c5eb41321e50c32d14ec54aa05a3b03e/datasets/20140222_01_01_03_250lm/"
)

_A2RL = _APPLICATIONS + "control_steer_dynamics_A2RL/A2RL_Data/"

PUBLIC: dict[str, PublicDataset] = {
    dataset.name: dataset
    for dataset in (
        PublicDataset(
            name="roboracer",
            about="RoboRacer 1:10 car, 20 Hz: training, validation, another tyre set, an added mass",
            source="https://github.com/tonegas/nnodely-applications",
            licence="none stated for the recordings: they are their authors'",
            reference="Mungiello et al., Vehicle dynamics learning from physics priors with model-structured neural "
            "networks",
            columns="roboracer",
            files=(
                Remote(
                    "train.csv",
                    _ROBORACER + quote("Complete Dynamics/training/ftg_stanley_total_training.csv"),
                    "92989645a9223db3d4881fcd5450fe4885dd9b1fee3bf73cc8b0e2eeb8d19bc2",
                ),
                Remote(
                    "valid.csv", _ROBORACER + quote("Complete Dynamics/validation/ftg_stanley_total_validation.csv")
                ),
                Remote(
                    "tire_set_1.csv",
                    _ROBORACER + "Robustness/tire_set_1.csv",
                    "899218c34a55c45e512b2cb36b0fc03903149ff60547634b86b5cae9353ca38e",
                ),
                Remote("single_mass.csv", _ROBORACER + "Robustness/single_mass.csv"),
            ),
        ),
        PublicDataset(
            name="revs_250lm",
            about="Ferrari 250 LM on a race track, 100 Hz, sideslip measured by GPS-INS",
            source="https://github.com/MBDS/sideslip-angle-vehicle-estimation",
            licence="MIT; recorded in Stanford's REVS programme",
            reference="Kegelman, Harbott, Gerdes, Insights into vehicle trajectories at the handling limits: analysing "
            "open data from race car drivers, 2017",
            columns="revs_250lm",
            files=tuple(
                Remote(f"{column}.txt", f"{_REVS}{column}.txt")
                for column in ("t", "delta", "vx", "vy", "beta_true", "yawRate", "axCG", "ayCG")
            ),
            joined="run1.csv",
        ),
        PublicDataset(
            name="a2rl",
            about="full-size autonomous racer, 20 Hz: two laps, steering commanded and measured",
            source="https://github.com/tonegas/nnodely-applications",
            licence="none stated for the recordings: they are their authors'",
            reference="Model-Structured Neural Networks to Control the Steering Dynamics of Autonomous Race Cars, "
            "arXiv 2507.20427",
            columns="",
            files=(
                Remote("training_lap.csv", _A2RL + "Training/Large/training_single_lap.csv"),
                Remote("validation_lap.csv", _A2RL + "Validation/Medium/Validation_single_lap.csv"),
            ),
        ),
        PublicDataset(
            name="revs_telemetry",
            about="Ferrari 250 LM on a race track, 20 Hz, further drives: hand wheel, accelerations, yaw",
            source="https://github.com/tonegas/nnodely-applications",
            licence="none stated there; recorded in Stanford's REVS programme",
            reference="Kegelman, Harbott, Gerdes, Insights into vehicle trajectories at the handling limits: analysing "
            "open data from race car drivers, 2017",
            columns="",
            files=tuple(
                Remote(f"{name}.csv", f"{_APPLICATIONS}vehicle_lateral_dynamics_estimation/telemetries/{place}")
                for name, place in (
                    ("train_0", "training/telemetry_train_0.csv"),
                    ("train_1", "training/telemetry_train_1.csv"),
                    ("valid_0", "validation/telemetry_valid_0.csv"),
                    ("test_0", "test/telemetry_test_0.csv"),
                )
            ),
        ),
        PublicDataset(
            name="abs",
            about="simulated car with anti-lock brakes on dry road and on ice, 20 Hz",
            source="https://github.com/tonegas/nnodely-applications",
            licence="none stated for the recordings: they are their authors'",
            reference="A Road Friction-Aware Anti-Lock Braking System Based on Model-Structured Neural Networks",
            columns="",
            files=tuple(
                Remote(f"{name}.csv", f"{_APPLICATIONS}road_friction_aware_ABS/datasets/data_{place}.csv")
                for name, place in (
                    ("dry", "dry_noise/dry_noise"),
                    ("ice", "ice_noise/ice_noise"),
                    ("test", "test/test_noise"),
                    ("grip", "grip/grip_condition_variation"),
                )
            ),
        ),
        PublicDataset(
            name="truck",
            about="Renault Premium truck, 200 Hz, 10 s trajectories: slalom, avoidance, constant radius",
            source="https://github.com/N9TT-9G0A-B7FQ-RANC/IEEE_RAL",
            licence="MIT",
            reference="Physics-guided approach with transfer learning in vehicle lateral dynamics",
            columns="truck",
        ),
    )
}
"""What `greybox datasets` knows."""


def public(name: str) -> PublicDataset:
    """A dataset by name. Raises `BadInput` where there is none."""
    if name not in PUBLIC:
        raise BadInput(f'There is no public dataset "{name}".{near_or_all(name, PUBLIC)}')
    return PUBLIC[name]


CHUNK = 1 << 16
SECONDS = 30
"""Without a byte for so long, a connection has failed."""
ATTEMPTS = 5
"""Times that a transfer is taken up again where it broke off."""
HASHES = "sha256.json"
"""Hashes of files whose hash is not known beforehand, as they were fetched first."""


def fetch(dataset: PublicDataset, folder: Path | None = None, say: Say = lambda _: None) -> tuple[Path, ...]:
    """Fetch a dataset's files, those that are not there yet.

    Parameters
    ----------
    dataset : what to fetch.
    folder : where to; None takes the folder `datasets` of the cache.
    say : is told what is going on.

    Returns
    -------
    The recordings' paths.

    Raises
    ------
    BadInput
        The source cannot be reached or has nothing there, or a file is not the one that is known.
    """
    if not dataset.files:
        raise BadInput(
            f"The files of {dataset.name} have no address that is known here; fetch them from {dataset.source} "
            f"yourself and read them with ‹columns› {dataset.columns}."
        )
    target = folder or folder_of(dataset)
    known = _known(target)
    paths = []
    for remote in dataset.files:
        path = target / remote.name
        expected = remote.sha256 or known.get(remote.name, "")
        if path.is_file() and (not expected or hash_of(path) == expected):
            say(f"{remote.name} is there")
        else:
            _fetched(remote, path, expected, say)
        if not remote.sha256:
            known[remote.name] = hash_of(path)
            write_atomically(target / HASHES, json.dumps(known, indent=1) + "\n", continued=True)
        paths.append(path)
    return (_joined(paths, target / dataset.joined),) if dataset.joined else tuple(paths)


def folder_of(dataset: PublicDataset) -> Path:
    """Where a dataset lies in the cache."""
    return cache_folder() / "datasets" / dataset.name


def _fetched(remote: Remote, path: Path, expected: str, say: Say) -> None:
    part = path.with_name(f"{path.name}.part")
    with writable(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        for attempt in range(1, ATTEMPTS + 1):
            if _transferred(remote, part, say):
                break
            say(f"{remote.name} broke off after {part.stat().st_size} bytes, attempt {attempt} of {ATTEMPTS}")
        else:
            raise BadInput(
                f"{remote.address} broke off {ATTEMPTS} times; what has come is kept in {part}, call again to go on."
            )
        result = hash_of(part)
        if expected and result != expected:
            part.unlink()
            raise BadInput(
                f"{remote.address} is not the file that is known: its SHA-256 is {result}, expected is {expected}. "
                "Nothing of it was kept. It may have been changed by its authors, or on the way."
            )
        permit(part, path)
        part.replace(path)


def _transferred(remote: Remote, part: Path, say: Say) -> bool:
    """Fetch what is missing of a file; False where the connection broke off before its end."""
    have = part.stat().st_size if part.exists() else 0
    request = urllib.request.Request(remote.address, headers={"User-Agent": f"greybox-id/{__version__}"})
    if have:
        request.add_header("Range", f"bytes={have}-")
    try:
        with urllib.request.urlopen(request, timeout=SECONDS) as answer:
            if answer.status != http.client.PARTIAL_CONTENT:
                have = 0  # the server sends all of it again
            length = answer.headers.get("Content-Length")
            whole = have + int(length) if length else None
            size = f", {whole / 1e6:.2f} MB" if whole else ""
            say(f"{'going on with' if have else 'fetching'} {remote.name}{size}")
            with part.open("ab" if have else "wb") as opened:
                while chunk := answer.read(CHUNK):
                    opened.write(chunk)
        return whole is None or part.stat().st_size >= whole
    except urllib.error.HTTPError as error:
        if error.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE and have:
            return True  # all of it had come; the hash tells whether it is right
        raise BadInput(f"{remote.address} answers {error.code} {error.reason}; has it moved?") from error
    except (urllib.error.URLError, TimeoutError, ConnectionError, http.client.HTTPException) as error:
        if part.exists() and part.stat().st_size > have:
            return False
        reason = getattr(error, "reason", error)
        raise BadInput(
            f"{remote.address} cannot be reached ({reason}). Is this machine online? Call again when it is; "
            "what has come is kept."
        ) from error


def _known(folder: Path) -> dict[str, Any]:
    try:
        known = json.loads((folder / HASHES).read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return known if isinstance(known, dict) else {}


def _joined(paths: list[Path], target: Path) -> Path:
    """One CSV file of columns that lie in files of their own."""
    columns = {}
    for path in paths:
        try:
            columns[path.stem] = np.loadtxt(path, ndmin=1)
        except (ValueError, OSError) as error:
            raise BadInput(f"{path} holds no column of numbers ({error}). Remove it and fetch again.") from error
    lengths = {len(values) for values in columns.values()}
    if len(lengths) != 1:
        raise BadInput(f"{target}: its columns have {sorted(lengths)} rows. Remove {target.parent} and fetch again.")
    with replacing(target) as beside:
        pd.DataFrame(columns).to_csv(beside, index=False)
    return target
