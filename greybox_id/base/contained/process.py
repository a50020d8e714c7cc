"""An object in a process of its own, whose methods are asked: what ends the process is told, and ends nothing else."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import weakref
from collections.abc import Callable, Mapping
from contextlib import suppress
from threading import Timer
from typing import Any

from numpy.typing import NDArray

from ..errors import GreyboxError
from . import inside

START = "import sys; sys.path[:] = {!r}; from greybox_id.base.contained.inside import main; main()"
"""What a process runs: it finds modules where this one does, and imports no script of a user's."""
QUIET = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "GREYBOX_THREADS"), "1"
)
"""Processes run side by side, and one that forks has no threads of its own."""
TIME = "time"
"""How a process ended that was not done in time."""


class Broken(GreyboxError):
    """No process can be started here, or not the work in it."""


class Failed(Exception):
    """What was asked could not be done; the process lives on.

    Attributes
    ----------
    kind : "missing", a module is not installed; "memory", there was not enough; "failed", anything else.
    """

    def __init__(self, kind: str, sentence: str) -> None:
        super().__init__(sentence)
        self.kind = kind


class Lost(Exception):
    """The process ended without an answer.

    Attributes
    ----------
    how : `TIME`, the name of the signal that ended it, "exit code 7", or "nonsense" where its answer was none.
    """

    def __init__(self, how: str) -> None:
        super().__init__(how)
        self.how = how


class Contained:
    """An object in a process of its own, which lives as long as this one is remembered.

    Parameters
    ----------
    kind : class of the object, as module:class.
    given : what it is made with: plain data.
    limits : s of the processor's time and bytes of memory that it may take from when its module is imported.
    environment : variables besides those of this process.
    heard : whether what it prints is shown.

    Raises
    ------
    Broken : no process can be started.
    """

    def __init__(
        self, kind: str, *given: Any, limits: tuple[float, int] | None = None,
        environment: Mapping[str, str] | None = None, heard: bool = False,
    ) -> None:  # fmt: skip
        begun = json.dumps({"kind": kind, "given": given, "limits": limits})
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", START.format(sys.path), begun],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=None if heard else subprocess.DEVNULL,
                env={**os.environ, **QUIET, **(environment or {})},
                start_new_session=True,  # Ctrl-C of a terminal is for who started it
            )
        except OSError as error:
            raise Broken(f"no process can be started ({error.strerror})") from error
        self.close = weakref.finalize(self, _ended, self._process)
        """End it at once, from any thread."""

    @property
    def alive(self) -> bool:
        """Whether it can be asked."""
        return self.close.alive and self._process.poll() is None

    def ask(
        self, question: str, *of: Any, patience: float, most: float = 0.0, hear: Callable[[Any], None] | None = None
    ) -> tuple[Any, NDArray[Any] | None]:
        """What the object's method of that name returns: what JSON holds, or an array.

        Parameters
        ----------
        patience : s by the clock after which the process is ended.
        most : bytes that an array may have.
        hear : is handed what the method yields, where it is a generator.

        Raises
        ------
        Failed : the object could not be made, or its method raised something.
        Lost : the process ended, or was ended, before it answered.
        """
        questions, answers = self._process.stdin, self._process.stdout
        assert questions is not None
        assert answers is not None
        watch = Timer(patience, self._process.kill)
        watch.daemon = True
        watch.start()
        try:
            inside.send(questions, {"ask": question, "of": of})
            while "told" in (message := inside.receive(answers, most))[0]:
                if hear is not None:
                    hear(message[0]["told"])
        except Exception as error:  # nothing is known of what a process writes that is about to crash
            late = watch.finished.is_set()
            raise Lost(TIME if late else self._end(isinstance(error, (EOFError, OSError)), patience)) from None
        except BaseException:
            self.close()
            raise
        finally:
            watch.cancel()
        reply, array = message
        if "failed" in reply:
            raise Failed(*reply["failed"])
        return reply.get("answer"), array

    def _end(self, silent: bool, patience: float) -> str:
        """How a process came to its end that answered nothing, or nonsense."""
        if silent:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(patience)
        code = self._process.poll()
        self.close()
        if code is None:
            return "nonsense"
        try:
            return signal.Signals(-code).name
        except ValueError:
            return f"exit code {code:#x}" if code > 255 else f"exit code {code}"


def _ended(process: subprocess.Popen[bytes]) -> None:
    """End a process and what it started."""
    with suppress(OSError):
        if sys.platform == "win32":
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with suppress(OSError):  # what was not sent yet
                stream.close()
