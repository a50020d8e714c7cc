"""The greybox command, called in this process: as a user calls it, without the second an interpreter takes to start."""

import io
import json
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass

from greybox_id.cli import main


@dataclass(frozen=True)
class Called:
    """What a call left: exit code, standard output and standard error."""

    code: int
    out: str
    err: str

    @property
    def told(self):
        """Its JSON."""
        return json.loads(self.out)


def greybox(*arguments) -> Called:
    """Call `greybox` with these arguments."""
    out, err = io.StringIO(), io.StringIO()
    before, sys.argv, code = sys.argv, ["greybox", *map(str, arguments)], 0
    try:
        with redirect_stdout(out), redirect_stderr(err):
            main()
    except SystemExit as end:
        code = int(end.code or 0)
    finally:
        sys.argv = before
    return Called(code, out.getvalue(), err.getvalue())


def refused(*arguments) -> str:
    """The sentence with which `greybox` refuses these arguments; it says nothing else, and exits with 2."""
    called = greybox(*arguments)
    assert called.code == 2, called.out
    assert "Traceback" not in called.err
    assert called.out == ""
    return " ".join(called.err.split())
