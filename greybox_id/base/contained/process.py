"""An object in an isolated process, whose methods are called through pipes: if it crashes, the caller gets an error."""

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
"""Code that the process runs: it uses the module path of this one and does not import the user's script."""
QUIET = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "GREYBOX_THREADS"), "1"
)
"""One thread for each library: processes run in parallel, and a process that forks must have no other threads."""
TIME = "time"
"""Outcome of a process that exceeded its time."""


class Broken(GreyboxError):
    """No process can be started, or the work cannot be begun in it."""


class Failed(Exception):
    """The call failed; the process still runs.

    Attributes
    ----------
    kind : "missing" (a module is not installed), "memory" (not enough memory) or "failed" (any other error).
    """

    def __init__(self, kind: str, sentence: str) -> None:
        super().__init__(sentence)
        self.kind = kind


class Lost(Exception):
    """The process ended without an answer.

    Attributes
    ----------
    how : `TIME`, the name of the signal that ended it, "exit code 7", or "nonsense" for an invalid answer.
    """

    def __init__(self, how: str) -> None:
        super().__init__(how)
        self.how = how


class Contained:
    """An object in an isolated process, which ends when this handle is garbage-collected.

    Parameters
    ----------
    kind : class of the object, as module:class.
    given : arguments of the class: plain data.
    limits : CPU time in s and memory in bytes that it may use once its module is imported.
    environment : environment variables, in addition to those of this process.
    heard : whether its standard error is shown.

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
                start_new_session=True,  # a terminal's Ctrl-C reaches only the process that started this one
            )
        except OSError as error:
            raise Broken(f"no process can be started ({error.strerror})") from error
        self.close = weakref.finalize(self, _ended, self._process)
        """Kill the process; callable from any thread."""

    @property
    def alive(self) -> bool:
        """Whether the process is running."""
        return self.close.alive and self._process.poll() is None

    def ask(
        self, question: str, *of: Any, patience: float, most: float = 0.0, hear: Callable[[Any], None] | None = None
    ) -> tuple[Any, NDArray[Any] | None]:
        """Call a method of the object: what it returns is (plain data, None) or (None, array).

        Parameters
        ----------
        question, of : name of the method, and its arguments.
        patience : wall-clock time in s after which the process is killed.
        most : bytes that a returned array may have.
        hear : called with each value that the method yields, if it is a generator.

        Raises
        ------
        Failed : the object could not be built, or its method raised an exception.
        Lost : the process ended, or was killed, before it answered.
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
        except Exception as error:  # a crashing process may write anything
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
        """Outcome of a process that sent no answer (`silent`) or an invalid one."""
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
    """Kill a process and its children."""
    with suppress(OSError):
        if sys.platform == "win32":
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with suppress(OSError):  # flushing data not yet sent
                stream.close()
