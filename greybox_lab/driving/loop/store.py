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
import math
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from greybox_id.base.declared import of_plain
from greybox_id.base.errors import BadInput
from greybox_id.base.files import ensure_writable, replacing, scratch_name, writable, write_atomically
from greybox_id.base.json_data import attributes, finite, read_json

from .protocol import ARMS, PROTOCOL, digest_of

FORMAT = "greybox-loop-store"
SESSION = re.compile(r"[A-Za-z0-9][A-Za-z0-9-]{0,63}")
SHA = re.compile(r"[0-9a-f]{64}")
JOB = re.compile(r"[0-9a-f]{16}")
KEPT, SESSIONS = 1 << 30, 1000
"""Bytes of rows that a session keeps at most, about 20 hours at 50 rows a second; and sessions."""
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
    session, arm, seconds, steps, seed, cap : see `ServerStore.train`.
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

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return {**asdict(self), "rows": list(self.rows), "result": dict(self.result)}

    def shown(self) -> dict[str, Any]:
        """What the page shows of it."""
        return attributes(self, "id", "session", "arm", "status", "sentence", "result")


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
        if folder.is_dir() and any(not entry.name.startswith(".greybox-") for entry in folder.iterdir()):
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

    def stage(self, body: bytes, suffix: str) -> Path:
        """A file under way with what was sent, to be checked; it takes its place by `add_policy` or `add_rows`."""
        with writable(self.folder):
            staged = scratch_name(self.folder, suffix)
            try:
                staged.write_bytes(body)
            except OSError:
                staged.unlink(missing_ok=True)
                raise
        return staged

    def has_policy(self, sha: str) -> bool:
        """Whether a policy is there."""
        return (self.folder / "policies" / f"{sha}.json").is_file()

    def add_policy(self, sha: str, checked: Path) -> None:
        """Keep a policy that was found to be one of a driver."""
        self._put(self.folder / "policies" / f"{sha}.json", checked)

    def hello(self, session: str, vehicle: str, policy: str) -> dict[str, Any]:
        """Begin a session, or go on with it.

        Parameters
        ----------
        session : letters, digits and dashes.
        vehicle : text of its vehicle file, which was checked where it is new.
        policy : SHA-256 of the one that drives.

        Raises
        ------
        Busy : the vehicle is another one than before.
        Full : there are too many sessions.
        Missing : the policy is not there.
        """
        if self.is_new(session, vehicle, policy):
            write_atomically(self._session(session) / "vehicle.toml", vehicle, continued=True)
        text = json.dumps({"policy": policy}) + "\n"
        write_atomically(self._session(session) / "session.json", text, continued=True)
        return {"protocol": PROTOCOL, "session": session, "policy": policy, "rows": len(self._rows(session))}

    def is_new(self, session: str, vehicle: str, policy: str) -> bool:
        """Whether a hello begins a session. Raises as `hello` does, and `BadInput` where the name is none."""
        if not SESSION.fullmatch(session):
            raise BadInput("A session is named by up to 64 letters, digits and dashes.")
        self.policy_file(policy)
        file = self._session(session) / "vehicle.toml"
        if file.is_file():
            if file.read_bytes() != vehicle.encode():
                raise Busy(f"Session {session} is that of another vehicle file; name another session.")
            return False
        folder = self.folder / "sessions"
        if folder.is_dir() and sum(1 for _ in folder.iterdir()) >= SESSIONS:
            raise Full(f"There are {SESSIONS} sessions already, the most that this server keeps; use one of them.")
        return True

    def rows_known(self, session: str, sha: str, size: int) -> bool:
        """Whether rows are there. Raises `Full` where they are not, and no room is left for so many bytes."""
        rows = self._rows(session)
        if any(file.stem == sha for file in rows):
            return True
        if sum(file.stat().st_size for file in rows) + size > KEPT:
            raise Full(f"Session {session} has {KEPT >> 20} MB of rows; begin another one.")
        return False

    def add_rows(self, session: str, sha: str, checked: Path | None) -> dict[str, Any]:
        """Keep rows that were checked; None: those that are there. Raises `Full`."""
        new = checked is not None and not self.rows_known(session, sha, checked.stat().st_size)
        if new and checked is not None:
            self._put(self._session(session) / "rows" / f"{sha}{checked.suffix}", checked)
        return {"sha256": sha, "new": new, "files": len(self._rows(session))}

    def train(self, session: str, options: Mapping[str, Any]) -> Job:
        """Put a job into the queue, or find the one that was asked for by the same words about the same rows.

        One that failed is queued once more.

        Parameters
        ----------
        session : whose rows it learns from.
        options : arm, seconds (budget of the processor's time), steps, seed, and cap (share of the grip).

        Raises
        ------
        BadInput : a number makes no sense, or there are no rows.
        Busy : the session has a job that is not over.
        """
        arm, numbers = _options(options)
        self.vehicle_text(session)
        rows = tuple(file.stem for file in self._rows(session))
        if not rows:
            raise BadInput(f"Session {session} has no rows to learn from; send some first.")
        policy = str(self._table(self._session(session) / "session.json").get("policy"))
        request = {"session": session, "arm": arm, **numbers, "rows": rows, "policy": policy}
        name = digest_of(json.dumps(request, sort_keys=True).encode())[:16]
        jobs = self.jobs()
        same = next((job for job in jobs if job.id == name and job.status != FAILED), None)
        if same is not None:
            return same
        if any(job.session == session and job.status in (QUEUED, TRAINING) for job in jobs):
            raise Busy(f"Session {session} has an unfinished job; wait for its end.")
        job = Job(name, session, arm, rows=rows, policy=policy, place=len(jobs), **numbers)
        self.keep(job)
        return job

    def keep(self, job: Job) -> None:
        """Write down how far a job is."""
        text = json.dumps(finite(job.to_json()), indent=1, allow_nan=False) + "\n"
        write_atomically(self.job_folder(job.id) / "job.json", text, continued=True)

    def job_folder(self, name: str) -> Path:
        """Where a job works."""
        return self.folder / "jobs" / name

    def job(self, name: str) -> Job:
        """A job; one of which the file is damaged has failed. Raises `Missing`."""
        file = self.job_folder(name) / "job.json"
        if not JOB.fullmatch(name) or not file.is_file():
            raise Missing("There is no such job.")
        try:
            return job_of(self._table(file))
        except BadInput:
            sentence = f"The file of this job is damaged; ask for it again, or remove {file}."
            return Job(name, "", "", 0.0, 0, 0, 0.0, (), "", 0, FAILED, sentence)

    def jobs(self) -> list[Job]:
        """All jobs, in the order in which they were asked for."""
        folder = self.folder / "jobs"
        entries = folder.iterdir() if folder.is_dir() else ()
        names = [entry.name for entry in entries if JOB.fullmatch(entry.name) and (entry / "job.json").is_file()]
        return sorted((self.job(name) for name in names), key=lambda job: (job.place, job.id))

    def finished(self, job: Job) -> Job:
        """Take over what a job's process left: its result and its policy. Raises `BadInput` where that is damaged."""
        folder = self.job_folder(job.id)
        result = self._table(folder / "result.json")
        sha = digest_of((folder / "policy.json").read_bytes())
        if result.get("policy") != sha:
            raise BadInput(f"What this job learned is damaged; remove {folder}, and ask for it again.")
        self.add_policy(sha, folder / "policy.json")
        over = replace(job, status=DONE, sentence="", result=result)
        self.keep(over)
        return over

    def vehicle_text(self, session: str) -> str:
        """The text of the vehicle file of a session. Raises `Missing`."""
        file = self._session(session) / "vehicle.toml"
        if not SESSION.fullmatch(session) or not file.is_file():
            raise Missing("There is no such session; begin it with POST /v1/hello.")
        return file.read_text("utf-8", "replace")

    def row_files(self, session: str, rows: Sequence[str]) -> list[Path]:
        """Files of rows, by their SHA-256. Raises `BadInput`."""
        files = {file.stem: file for file in self._rows(session)}
        if gone := [sha for sha in rows if sha not in files]:
            raise BadInput(f"Rows {gone[0][:8]} of session {session} are gone; send them again.")
        return [files[sha] for sha in rows]

    def _session(self, name: str) -> Path:
        return self.folder / "sessions" / name

    def _rows(self, session: str) -> list[Path]:
        """Files of rows, in the order in which they came."""
        folder = self._session(session) / "rows"
        files = [file for file in folder.iterdir() if SHA.fullmatch(file.stem)] if folder.is_dir() else []
        return sorted(files, key=lambda file: (file.stat().st_mtime_ns, file.name))

    def _put(self, file: Path, checked: Path) -> None:
        with replacing(file, continued=True) as beside:
            shutil.copyfile(checked, beside)

    @staticmethod
    def _table(file: Path) -> dict[str, Any]:
        table = read_json(file)
        if not isinstance(table, dict):
            raise BadInput(f"{file} is damaged; remove it.")
        return table


def job_of(table: Mapping[str, Any]) -> Job:
    """A job of the plain data of its file. Raises `BadInput` where that is damaged."""
    try:
        job: Job = of_plain(Job, table, "job")
        sound = math.isfinite(job.seconds + job.cap) and job.status in (QUEUED, TRAINING, DONE, FAILED)
    except TypeError as error:
        raise BadInput(f"The job is damaged ({error}).") from error
    if not sound:
        raise BadInput("The job is damaged.")
    return job


def _options(options: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """An arm and its numbers."""
    arm = options.get("arm", "named")
    if not isinstance(arm, str) or arm not in ARMS:
        raise BadInput(f"There is no arm {arm!r:.40}; choose one of {', '.join(ARMS)}.")
    limits = {"seconds": (1.0, 3600.0, 120.0), "steps": (1, 10_000_000, 24_576), "seed": (0, 2**31, 0)}
    numbers: dict[str, Any] = {}
    for name, (low, high, usual) in {**limits, "cap": (0.1, 1.0, 0.6)}.items():
        value = options.get(name, usual)
        if isinstance(value, bool) or not isinstance(value, type(usual) | int) or not low <= value <= high:
            raise BadInput(f"{name} is a number from {low:g} to {high:g}, not {value!r:.40}.")
        numbers[name] = type(usual)(value)
    if unknown := sorted(set(options) - {"arm", *numbers}):
        raise BadInput(f"There is no option {unknown[0]!r:.40}; the options are arm, {', '.join(numbers)}.")
    return arm, numbers
