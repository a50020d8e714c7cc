"""Keeping a process away from answers: it may open nothing of an examination but the case that it was handed."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

LOOKS = ("open", "os.listdir", "os.scandir", "os.chdir", "os.rename", "os.link", "os.symlink", "shutil.copyfile")
"""Audit events whose arguments are paths that are read or may be read afterwards."""


class Peeked(BaseException):
    """Something of the examination was opened that was not handed out; no handler of ordinary errors holds it up."""


class Confinement:
    """What a process may open of an examination; once laid on it cannot be taken off.

    Parameters
    ----------
    exam : folder of the examination.

    Attributes
    ----------
    peeked : sentence on the first thing that was refused; "" as long as nothing was.
    """

    def __init__(self, exam: Path) -> None:
        self.peeked = ""
        self._inside = os.path.realpath(exam)
        self._case = ""
        sys.addaudithook(self._hook)

    def hand_out(self, case: Path) -> None:
        """Allow one case, instead of the one before."""
        self._case = os.path.realpath(case)

    def _hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event in LOOKS:
            paths = arguments[: 2 if event not in ("open", "os.listdir", "os.scandir", "os.chdir") else 1]
        elif event == "subprocess.Popen":
            paths = tuple(word for word in arguments[1] or () if self._inside in str(word))
        else:
            return
        for path in paths:
            if isinstance(path, (str, bytes, os.PathLike)):
                self._judge(os.path.realpath(os.fsdecode(path)))

    def _judge(self, path: str) -> None:
        if _within(path, self._inside) and not (self._case and _within(path, self._case)):
            self.peeked = self.peeked or f"The candidate tried to open {path}, which was not handed out."
            raise Peeked(self.peeked)


def _within(path: str, folder: str) -> bool:
    return path == folder or path.startswith(folder + os.sep)
