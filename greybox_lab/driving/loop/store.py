"""What a server keeps: policies, sessions with their rows, and jobs; a kill at any moment leaves it whole.

    FOLDER/store.json                      what this folder is
    FOLDER/policies/SHA256.json
    FOLDER/sessions/NAME/session.json      policy that drives
    FOLDER/sessions/NAME/vehicle.toml
    FOLDER/sessions/NAME/rows/SHA256.csv   or .parquet
    FOLDER/jobs/ID/job.json                what is asked for, and how far it is
    FOLDER/jobs/ID/result.json, policy.json

No name in it is a client's but that of a session, which is letters, digits and dashes. Rows are validated before they
take their place, and whatever is there is complete: files are written beside and put in place in one step.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from greybox_id.api.diagnosing import must_be_diagnosable
from greybox_id.base.errors import BadInput
from greybox_id.base.files import ensure_writable, replacing, write_atomically
from greybox_id.base.json_data import finite, read_json
from greybox_id.base.toml_file import parse_toml
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.models.effects import EFFECTS
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.registry import motion_model_of, vehicle_parameters
from greybox_id.models.vehicle import Vehicle
from greybox_id.models.vehicle_file import parse_vehicle

from .buffer import continued
from .protocol import ARMS, digest_of
from .state import of_bytes
from .swap import drivers_policy

FORMAT = "greybox-loop-store"
SESSION = re.compile(r"[A-Za-z0-9][A-Za-z0-9-]{0,63}")
SHA = re.compile(r"[0-9a-f]{64}")
JOB = re.compile(r"[0-9a-f]{16}")
KEPT = 1 << 30
"""Bytes of rows that a session keeps at most: about 20 hours at 50 rows a second."""
QUEUED, TRAINING, DONE, FAILED = "queued", "training", "done", "failed"


class Missing(BadInput):
    """There is no such session, job or policy."""


class Busy(BadInput):
    """What is asked for is not done twice at a time."""


class Full(BadInput):
    """No more is kept."""


@dataclass(frozen=True)
class Job:
    """What is to be learned.

    Attributes
    ----------
    id : 16 hexadecimal digits, from what is asked for: the same request is the same job.
    session, arm, seconds, steps, seed, cap : see `ServerStore.asked`.
    rows : SHA-256 of the rows that it learns from.
    policy : SHA-256 of the one it goes on from.
    place : in the queue.
    status : "queued", "training", "done" or "failed".
    sentence : why it failed; what it is at.
    result : what came of it: SHA-256 of the policy, what was named and applied.
    """

    id: str
    session: str
    arm: str
    seconds: float
    steps: int
    seed: int
    cap: float
    rows: tuple[str, ...]
    policy: str
    place: int
    status: str = QUEUED
    sentence: str = ""
    result: Mapping[str, Any] = field(default_factory=dict)

    def told(self) -> dict[str, Any]:
        """As plain data."""
        return {**asdict(self), "rows": list(self.rows), "result": dict(self.result)}


class ServerStore:
    """A folder with everything that a server knows.

    Parameters
    ----------
    folder : made where it is not there.

    Raises
    ------
    BadInput : it holds something else, or cannot be written to.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        mark = folder / "store.json"
        if folder.is_dir() and any(not own.name.startswith(".greybox-") for own in folder.iterdir()):
            known = read_json(mark) if mark.is_file() else None
            if not isinstance(known, dict) or known.get("format") != FORMAT:
                raise BadInput(f"{folder} holds something else than a server's state; name another folder with ‹out›.")
        ensure_writable(folder)
        if not mark.is_file():
            write_atomically(mark, json.dumps({"format": FORMAT, "format_version": 1}) + "\n")

    def policy_file(self, sha: str) -> Path:
        """The file of a policy. Raises `Missing`."""
        file = self.folder / "policies" / f"{sha}.json"
        if not SHA.fullmatch(sha) or not file.is_file():
            raise Missing("There is no such policy; send it with POST /v1/policies.")
        return file

    def add_policy(self, body: bytes) -> str:
        """Keep a policy; its SHA-256. Raises `BadInput` where it is none or has other shapes than a driver."""
        sha = digest_of(body)
        file = self.folder / "policies" / f"{sha}.json"
        if not file.is_file():
            of_bytes(body, self.folder, ".json", "policy", drivers_policy)
            self._put(file, body)
        return sha

    def hello(self, session: str, vehicle: str, policy: str) -> dict[str, Any]:
        """Begin a session, or go on with it.

        Parameters
        ----------
        session : letters, digits and dashes.
        vehicle : text of its vehicle file.
        policy : SHA-256 of the one that drives.

        Raises
        ------
        BadInput : the name is none, the vehicle cannot be used, or is another one than before.
        Missing : the policy is not there.
        """
        if not SESSION.fullmatch(session):
            raise BadInput("A session is named by up to 64 letters, digits and dashes.")
        self.policy_file(policy)
        folder = self.folder / "sessions" / session
        file = folder / "vehicle.toml"
        if file.is_file() and file.read_text("utf-8") != vehicle:
            raise Busy(f"Session {session} is that of another vehicle file; name another session.")
        if not file.is_file():
            vehicle_of(vehicle)
            write_atomically(file, vehicle, continued=True)
        write_atomically(folder / "session.json", json.dumps({"policy": policy}) + "\n", continued=True)
        return {"protocol": 1, "session": session, "policy": policy, "rows": len(self._rows(session))}

    def add_rows(self, session: str, body: bytes) -> dict[str, Any]:
        """Keep rows of a vehicle; the same bytes are kept once.

        Raises
        ------
        BadInput : they cannot be read, or lack what the vehicle's model reads.
        Missing, Full : there is no such session; it keeps no more.
        """
        vehicle = self.vehicle(session)
        sha = digest_of(body)
        suffix = ".parquet" if body.startswith(b"PAR1") else ".csv"
        file = self.folder / "sessions" / session / "rows" / f"{sha}{suffix}"
        new = not file.is_file()
        if new:
            held = self._rows(session)
            if sum(own.stat().st_size for own in held) + len(body) > KEPT:
                raise Full(f"Session {session} has {KEPT >> 20} MB of rows; begin another one.")
            model = motion_model_of(vehicle)
            rows = len(of_bytes(body, self.folder, suffix, "rows", lambda scratch: usable(model, scratch)))
            self._put(file, body)
            return {"sha256": sha, "new": True, "rows": rows, "files": len(held) + 1}
        return {"sha256": sha, "new": False, "rows": None, "files": len(self._rows(session))}

    def ask(self, session: str, wanted: Mapping[str, Any]) -> Job:
        """Put a job into the queue, or find the one that was asked for by the same words about the same rows.

        Parameters
        ----------
        session : whose rows it learns from.
        wanted : arm, seconds (budget of the processor's time), steps, seed, and cap (share of the grip).

        Raises
        ------
        BadInput : a number makes no sense, or there are no rows.
        Busy : the session has a job that is not over.
        """
        arm, numbers = _wanted(wanted)
        self.vehicle(session)
        rows = tuple(own.stem for own in self._rows(session))
        if not rows:
            raise BadInput(f"Session {session} has no rows to learn from; send some first.")
        policy = str(self._plain(self.folder / "sessions" / session / "session.json")["policy"])
        asked = {"session": session, "arm": arm, **numbers, "rows": rows, "policy": policy}
        own = digest_of(json.dumps(asked, sort_keys=True).encode())[:16]
        jobs = self.jobs()
        same = next((job for job in jobs if job.id == own), None)
        if same is not None:
            return same
        if any(job.session == session and job.status in (QUEUED, TRAINING) for job in jobs):
            raise Busy(f"Session {session} has a job that is not over; wait for it.")
        job = Job(own, session, arm, rows=rows, policy=policy, place=len(jobs), **numbers)
        self.keep(job)
        return job

    def keep(self, job: Job) -> None:
        """Write down how far a job is."""
        text = json.dumps(finite(job.told()), indent=1, allow_nan=False) + "\n"
        write_atomically(self.job_folder(job.id) / "job.json", text, continued=True)

    def job_folder(self, own: str) -> Path:
        """Where a job works."""
        return self.folder / "jobs" / own

    def job(self, own: str) -> Job:
        """A job. Raises `Missing`."""
        file = self.job_folder(own) / "job.json"
        if not JOB.fullmatch(own) or not file.is_file():
            raise Missing("There is no such job.")
        held = self._plain(file)
        return Job(**{**held, "rows": tuple(held["rows"])})

    def jobs(self) -> list[Job]:
        """All jobs, in the order in which they were asked for."""
        folder = self.folder / "jobs"
        names = [own.name for own in folder.iterdir() if (own / "job.json").is_file()] if folder.is_dir() else []
        return sorted((self.job(name) for name in names), key=lambda job: (job.place, job.id))

    def finished(self, own: str) -> Job:
        """Take over what a job's process left: its result and its policy. Raises `BadInput` where that is damaged."""
        folder = self.job_folder(own)
        result = self._plain(folder / "result.json")
        sha = self.add_policy((folder / "policy.json").read_bytes())
        job = replace(self.job(own), status=DONE, sentence="", result={**result, "policy": sha})
        self.keep(job)
        return job

    def vehicle(self, session: str) -> Vehicle:
        """The vehicle of a session. Raises `Missing`."""
        file = self.folder / "sessions" / session / "vehicle.toml"
        if not SESSION.fullmatch(session) or not file.is_file():
            raise Missing("There is no such session; begin it with POST /v1/hello.")
        return vehicle_of(file.read_text("utf-8"))

    def recordings(self, session: str, rows: Sequence[str]) -> list[Recording]:
        """Rows as they are diagnosed, by their SHA-256; parts of one drive as one."""
        files = {own.stem: own for own in self._rows(session)}
        return continued([read(files[sha]) for sha in rows])

    def _rows(self, session: str) -> list[Path]:
        """Files of rows, in the order in which they came."""
        folder = self.folder / "sessions" / session / "rows"
        found = [own for own in folder.iterdir() if SHA.fullmatch(own.stem)] if folder.is_dir() else []
        return sorted(found, key=lambda own: (own.stat().st_mtime_ns, own.name))

    def _put(self, file: Path, body: bytes) -> None:
        with replacing(file, continued=True) as beside:
            beside.write_bytes(body)

    @staticmethod
    def _plain(file: Path) -> dict[str, Any]:
        held = read_json(file)
        if not isinstance(held, dict):
            raise BadInput(f"{file} is damaged; remove it.")
        return held


def _wanted(wanted: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """An arm and its numbers."""
    arm = wanted.get("arm", "named")
    if arm not in ARMS:
        raise BadInput(f"There is no arm {arm!r:.40}; there are {', '.join(ARMS)}.")
    limits = {"seconds": (1.0, 3600.0, 120.0), "steps": (1, 10_000_000, 24_576), "seed": (0, 2**31, 0)}
    found: dict[str, Any] = {}
    for name, (low, high, usual) in {**limits, "cap": (0.1, 1.0, 0.6)}.items():
        value = wanted.get(name, usual)
        if isinstance(value, bool) or not isinstance(value, type(usual) | int) or not low <= value <= high:
            raise BadInput(f"{name} is a number from {low:g} to {high:g}, not {value!r:.40}.")
        found[name] = type(usual)(value)
    if unknown := sorted(set(wanted) - {"arm", *found}):
        raise BadInput(f"There is no {unknown[0]!r:.40} to ask for; there are arm, {', '.join(found)}.")
    return arm, found


def vehicle_of(text: str) -> Vehicle:
    """A vehicle from the text of its file, which names no other file. Raises `BadInput`."""
    if "tyre_file" in parse_toml(text, "vehicle.toml"):
        raise BadInput("tyre_file: a vehicle file that is sent names no other file; write the tyre's parameters in it.")
    found = parse_vehicle(text, Path("vehicle.toml"), vehicle_parameters(), EFFECTS)
    motion_model_of(found)
    return found


def usable(model: MotionModel, file: Path) -> Recording:
    """Rows that a vehicle recorded. Raises `BadInput` where they cannot be diagnosed."""
    found = read(file)
    must_be_diagnosable(model, [found])
    needed = [name for name in ("v_x", "yaw_rate", *model.inputs) if name in found]
    bare = [name for name in needed if not np.any(np.isfinite(found[name]))]
    if bare:
        raise BadInput(f"rows: {bare[0]} holds no number.")
    return found
