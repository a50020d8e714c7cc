"""Long work: a command of greybox in a process of its own, with progress and a stop, that outlives the page.

A job is a folder: `job.json` says what runs, `log.txt` holds its lines of progress, `out.json` what it printed. Whoever
reads the folder knows how far it is, also after the process that started it was killed.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .beneath import write_atomically

MEMORY = 8 * 2**30
"""Bytes of address space of a command: what a file can make of itself when it is read ends there, not the machine."""
RUN = (
    "import sys\n"
    "try:\n"
    f"    import resource; resource.setrlimit(resource.RLIMIT_AS, ({MEMORY}, {MEMORY}))\n"
    "except (ImportError, ValueError, OSError): pass\n"
    "from greybox_id.cli import main\n"
    "try: main()\n"
    f"except MemoryError: sys.exit('greybox: this takes more than {MEMORY >> 30} GB of memory; use a smaller file.')\n"
)


@dataclass(frozen=True)
class PageJob:
    """A command that runs or has run: what it is for, its words, what it writes, its folder, its process, its start."""

    kind: str
    words: tuple[str, ...]
    target: str
    folder: Path
    pid: int
    started: float

    @property
    def command(self) -> str:
        """As a person types it in the session's folder."""
        return shlex.join(["greybox", *(word for word in self.words if word != "--json")])

    @property
    def running(self) -> bool:
        """Whether its process is alive and is this job's."""
        process = _children.get(self.pid)
        if process is not None:
            return process.poll() is None
        try:
            os.kill(self.pid, 0)
        except (OSError, OverflowError):
            return False
        line = Path(f"/proc/{self.pid}/cmdline")
        return str(self.folder).encode() in line.read_bytes() if line.exists() else True

    @property
    def lines(self) -> list[str]:
        """Its lines of progress, and the sentence it ended with where it failed."""
        with suppress(OSError):
            return (self.folder / "log.txt").read_text("utf-8", "replace").splitlines()
        return []

    @property
    def place(self) -> dict[str, float]:
        """Where a fit is: the parameters of its last step so far."""
        stepped = next((line for line in reversed(self.lines) if "=" in line), "")
        return {name: float(value) for name, value in re.findall(r"(\w+)=(-?[\d.]+(?:e[-+]?\d+)?)", stepped)}

    @property
    def answer(self) -> dict[str, Any] | None:
        """What it printed; None where it has not, or has failed."""
        with suppress(OSError, ValueError):
            answer = json.loads((self.folder / "out.json").read_text("utf-8"))
            return answer if isinstance(answer, dict) else None
        return None

    @property
    def failure(self) -> str:
        """Why it has no answer, as a sentence; "" while it runs and where it has one."""
        if self.running or self.answer is not None:
            return ""
        sentences = [line.removeprefix("greybox: ") for line in self.lines if line.startswith("greybox: ")]
        if sentences and sentences[-1] != "interrupted":
            return sentences[-1]
        return (
            "The command was stopped before it finished."
            if sentences
            else ("The command ended without a result; run it again.")
        )

    def stop(self) -> None:
        """Interrupt it as Ctrl-C does: what it knows is kept; a second time, end it."""
        flag = self.folder / "stopped"
        with suppress(OSError):
            os.kill(self.pid, signal.SIGKILL if flag.exists() else signal.SIGINT)
            flag.touch()


_children: dict[int, subprocess.Popen[bytes]] = {}


class Jobs:
    """The jobs of a session, in whose folder commands run."""

    def __init__(self, session: Path) -> None:
        self.session = session
        self._known: dict[Path, PageJob] = {}

    def start(self, kind: str, words: Sequence[str], target: str = "") -> PageJob:
        """Run `greybox WORDS --json` in the session's folder."""
        number = 1 + max((int(each.name.split("_")[0]) for each in self._folders()), default=0)
        folder = self.session / "jobs" / f"{number:03d}_{kind}"
        folder.mkdir(parents=True)
        every = (*words, "--json")
        environment = os.environ | {"PYTHONUNBUFFERED": "1", "GREYBOX_PROGRESS": "all"}
        with (folder / "out.json").open("wb") as out, (folder / "log.txt").open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-c", f"{RUN}# {folder}", *every],
                cwd=self.session, stdin=subprocess.DEVNULL, stdout=out, stderr=log, env=environment,
                start_new_session=True,
            )  # fmt: skip
        _children[process.pid] = process
        job = PageJob(kind, tuple(every), target, folder, process.pid, time.time())
        body = asdict(job) | {"folder": folder.name}
        write_atomically(folder / "job.json", json.dumps(body, ensure_ascii=False))
        self._known[folder] = job
        return job

    def all(self) -> list[PageJob]:
        """Every job of the session, the oldest first."""
        return [job for folder in sorted(self._folders()) if (job := self._job(folder)) is not None]

    def running(self) -> list[PageJob]:
        """Those that run."""
        return [job for job in self.all() if job.running]

    def stop(self) -> None:
        """Interrupt all, and give them time to keep what they know."""
        running = self.running()
        for job in running:
            job.stop()
        until = time.time() + 5.0
        while time.time() < until and any(job.running for job in running):
            time.sleep(0.05)

    def _folders(self) -> list[Path]:
        return [each for each in (self.session / "jobs").glob("*_*") if each.name.split("_")[0].isdecimal()]

    def _job(self, folder: Path) -> PageJob | None:
        if folder not in self._known:
            try:
                body = json.loads((folder / "job.json").read_text("utf-8"))
                self._known[folder] = PageJob(**{**body, "folder": folder, "words": tuple(map(str, body["words"]))})
            except (OSError, ValueError, KeyError, TypeError):
                return None
        return self._known[folder]
