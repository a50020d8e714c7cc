"""Reading a file in an isolated process: if it crashes or exceeds its limits, the caller gets a `BadInput`.

The libraries that read HDF5 and MDF expect sound files; some damage crashes them and the process they run in. Results
are returned as JSON and plain arrays (`base/contained/inside.py`), so nothing in them is executed.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from numpy.typing import NDArray

from ...base.contained.process import TIME, Broken, Contained, Failed, Lost
from ...base.errors import BadInput
from . import missing, unsound

SECONDS, SECONDS_PER_BYTE = 4.0, 1e-6
"""Limit of CPU time in s, for any file and per byte; a sound file takes at most a tenth of the latter."""
MEMORY, MEMORY_PER_BYTE = 800e6, 32
"""Limit of memory in bytes beyond that of the modules, for any file and per byte: signals may be compressed."""
PATIENCE = 10
"""Limit of wall-clock time over limit of CPU time, since the machine may be busy."""
TEMPORARY = ("TMPDIR", "TEMP", "TMP")
"""Environment variables for the folder of temporary files."""
FROM_OUTSIDE = ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP")
ADVICE = "restore it or export it again"


@dataclass(frozen=True)
class Limits:
    """Limits of a reader.

    Attributes
    ----------
    seconds : CPU time, s.
    memory : bytes, beyond those of its modules.
    patience : wall-clock time for one answer, s.
    """

    seconds: float
    memory: float
    patience: float

    @classmethod
    def of(cls, file: Path) -> Limits:
        """Limits that suffice for a sound file of this size."""
        size = file.stat().st_size
        seconds = SECONDS + SECONDS_PER_BYTE * size
        return cls(seconds, MEMORY + MEMORY_PER_BYTE * size, PATIENCE * seconds)


class Apart:
    """The reader of a file, in a process that ends when this object is garbage-collected.

    Parameters
    ----------
    file : the file.
    reader : one of the classes in `readers`, as module:class.
    kind, extra : the kind of file and the extra that installs its library, for sentences.
    limits : of the reader; by default those that suffice for a sound file.

    Raises
    ------
    BadInput
        No process can be started.
    """

    def __init__(self, file: Path, reader: str, kind: str, extra: str, limits: Limits | None = None) -> None:
        self._file, self._kind, self._extra = file, kind, extra
        self._limits = limits or Limits.of(file)
        folder = TemporaryDirectory(prefix="greybox")  # owned here, since a reader that crashes leaves files behind
        taken = self._limits.seconds, int(self._limits.memory)
        try:
            self._reader = Contained(
                reader, str(file), folder.name, limits=taken, environment=dict.fromkeys(TEMPORARY, folder.name)
            )
        except Broken as error:
            folder.cleanup()
            raise BadInput(f"{file} cannot be read: {error}. Try again.") from error
        self._end = weakref.finalize(self, _ended, self._reader, folder)

    def answer(self, question: str, *of: Any) -> Any:
        """Plain data that the reader's method of that name returns. Raises as `array` does."""
        return self._asked(question, of)[0]

    def array(self, question: str, *of: Any) -> NDArray[Any]:
        """The array that the reader's method of that name returns.

        Raises
        ------
        BadInput
            The library is not installed, or the file is damaged: the reader raised an error, crashed, or exceeded a
            limit.
        """
        result = self._asked(question, of)[1]
        if result is None:
            raise unsound(str(self._file), self._kind, "no values")
        return result

    def _asked(self, question: str, of: tuple[Any, ...]) -> tuple[Any, NDArray[Any] | None]:
        """Call one method of the reader."""
        if not self._end.alive:
            raise BadInput(f"{self._file} is damaged: it could not be read before; {ADVICE}.")
        try:
            return self._reader.ask(question, *of, patience=self._limits.patience, most=self._limits.memory)
        except Failed as error:
            if error.kind == "missing":
                raise missing(str(error), self._extra, str(self._file), self._kind) from None
            if error.kind == "memory":
                raise BadInput(self._took(f"{self._limits.memory / 1e9:.2g} GB of memory")) from None
            raise unsound(str(self._file), self._kind, str(error)) from None
        except Lost as error:
            self._end()
            raise BadInput(self._why(error.how)) from None
        except BaseException:
            self._end()
            raise

    def _why(self, how: str) -> str:
        """Sentence on why a reader did not answer."""
        if how == TIME:
            return self._took(f"{self._limits.patience:g} s")
        if how == "SIGXCPU":
            return self._took(f"{self._limits.seconds:.0f} s")
        if how in FROM_OUTSIDE:
            return (
                f"{self._file} was not read: another program, or the system, ended the process that read it "
                f"({how}). Free memory and try again."
            )
        return f"{self._file} is damaged: reading it ended in {how}; {ADVICE}."

    def _took(self, what: str) -> str:
        return f"{self._file} is damaged, or too large: reading it took more than {what}; {ADVICE}."


def _ended(reader: Contained, folder: TemporaryDirectory[str]) -> None:
    reader.close()
    folder.cleanup()
