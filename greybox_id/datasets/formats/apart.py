"""A file read in a process of its own: what ends that process, or takes too long or too much, becomes a sentence.

The libraries that read HDF5 and MDF are written for files that are sound; some damage makes them crash, and with them
whatever process they are in. What comes back is JSON and plain arrays (`readers/wire.py`): nothing of it is executed.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import weakref
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Timer
from typing import Any

from numpy.typing import NDArray

from ...errors import BadInput
from ..readers import wire
from .contents import missing, unsound

START = "import sys; sys.path[:] = {!r}; from greybox_id.datasets.readers.child import main; main()"
"""What the process runs: it finds modules where this one does, and imports neither a user's script nor the package."""
SECONDS, SECONDS_PER_BYTE = 4.0, 1e-6
"""Of the processor's time, for any file and for its size; a sound one takes at most a tenth of the latter."""
MEMORY, MEMORY_PER_BYTE = 800e6, 32
"""Bytes beyond what the modules take, for any file and for its size: measured signals may be compressed."""
PATIENCE = 10
"""How many times as long as of the processor's time it may take by the clock: the machine may be busy."""
FROM_OUTSIDE = ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP")
ADVICE = "restore it or export it again"


@dataclass(frozen=True)
class Limits:
    """What a reader may take.

    Attributes
    ----------
    seconds : of the processor's time, in s.
    memory : bytes, beyond what its modules take.
    patience : s by the clock, for one answer.
    """

    seconds: float
    memory: float
    patience: float

    @classmethod
    def of(cls, file: Path) -> Limits:
        """What is enough for a sound file of this size."""
        size = file.stat().st_size
        seconds = SECONDS + SECONDS_PER_BYTE * size
        return cls(seconds, MEMORY + MEMORY_PER_BYTE * size, PATIENCE * seconds)


class Apart:
    """The reader of a file, in a process that lives as long as this object is remembered.

    Parameters
    ----------
    file : the file.
    reader : a class, as those in `readers`, as module:class.
    kind, extra : the kind of file and the extra that brings its library, for sentences.
    limits : what the reader may take; by default what is enough for a sound file.

    Raises
    ------
    BadInput
        No process can be started.
    """

    def __init__(self, file: Path, reader: str, kind: str, extra: str, limits: Limits | None = None) -> None:
        self._file, self._kind, self._extra = file, kind, extra
        self._limits = limits or Limits.of(file)
        folder = TemporaryDirectory(prefix="greybox")  # not the reader's own: one that crashes leaves files there
        taken = str(self._limits.seconds), str(int(self._limits.memory))
        code = START.format(sys.path)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", code, reader, str(file), folder.name, *taken],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
        except OSError as error:
            folder.cleanup()
            raise BadInput(
                f"{file} cannot be read: no process can be started ({error.strerror}). Try again."
            ) from error
        self._end = weakref.finalize(self, _ended, self._process, folder)

    def answer(self, question: str, *of: Any) -> Any:
        """What the reader's method of that name says: whatever JSON holds. Raises as `array` does."""
        return self._asked(question, of)[0]

    def array(self, question: str, *of: Any) -> NDArray[Any]:
        """The array that the reader's method of that name returns.

        Raises
        ------
        BadInput
            The library is not installed, or the file is damaged: the reader said so, crashed, or met a limit.
        """
        found = self._asked(question, of)[1]
        if found is None:
            raise unsound(str(self._file), self._kind, "no values")
        return found

    def _asked(self, question: str, of: tuple[Any, ...]) -> tuple[Any, NDArray[Any] | None]:
        """One question and its answer."""
        if not self._end.alive:
            raise BadInput(f"{self._file} is damaged: it could not be read before; {ADVICE}.")
        watch = Timer(self._limits.patience, self._process.kill)
        watch.daemon = True
        watch.start()
        try:
            said, array = self._exchanged(question, of)
        except Exception as error:  # nothing is known of what a process writes that is about to crash
            hung = watch.finished.is_set()
            raise BadInput(self._why(hung, isinstance(error, (EOFError, OSError)))) from None
        except BaseException:
            self._end()
            raise
        finally:
            watch.cancel()
        if "missing" in said:
            raise missing(str(said["missing"]), self._extra, str(self._file), self._kind)
        if "memory" in said:
            raise BadInput(self._took(f"{self._limits.memory / 1e9:.2g} GB of memory"))
        if "failed" in said:
            raise unsound(str(self._file), self._kind, str(said["failed"]))
        return said.get("answer"), array

    def _exchanged(self, question: str, of: tuple[Any, ...]) -> tuple[dict[str, Any], NDArray[Any] | None]:
        assert self._process.stdin
        assert self._process.stdout
        wire.send(self._process.stdin, {"ask": question, "of": of})
        return wire.receive(self._process.stdout, self._limits.memory)

    def _why(self, hung: bool, silent: bool) -> str:
        """How a reader came to its end that did not answer."""
        if silent and not hung:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(self._limits.patience)
        code = self._process.poll()
        self._end()
        name = _name(code)
        if hung:
            return self._took(f"{self._limits.patience:g} s")
        if name == "SIGXCPU":
            return self._took(f"{self._limits.seconds:.0f} s")
        if name in FROM_OUTSIDE:
            return f"{self._file} was not read: its reader was ended from outside ({name}). Free memory and try again."
        return f"{self._file} is damaged: reading it ended in {name or 'nonsense'}; {ADVICE}."

    def _took(self, what: str) -> str:
        return f"{self._file} is damaged, or too large: reading it took more than {what}; {ADVICE}."


def _name(code: int | None) -> str:
    """How a process ended, in a word; empty if it did not."""
    if code is None:
        return ""
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"exit code {code:#x}" if code > 255 else f"exit code {code}"


def _ended(process: subprocess.Popen[bytes], folder: TemporaryDirectory[str]) -> None:
    process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout):
        if stream:
            with suppress(OSError):  # what was not sent yet
                stream.close()
    folder.cleanup()
