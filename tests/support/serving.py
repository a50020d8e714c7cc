"""A server in a process of its own, as users start it."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

from greybox_lab.driving.loop.client import Client

TOKEN = b"a token that is long enough"
START = "import sys; sys.path[:] = {!r}; from greybox_id.cli import main; main()"


class Serving:
    """A server's process, its address and a client of it."""

    def __init__(self, folder: Path) -> None:
        (folder / "token.txt").write_bytes(TOKEN + b"\n")
        self.folder = folder / "state"
        self.process = subprocess.Popen(
            [sys.executable, "-c", START.format(sys.path), "serve", "--token-file", str(folder / "token.txt"),
             "--port", "0", "--out", str(self.folder)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        self.address = self.process.stdout.readline().strip()
        assert self.address, self.process.stderr.read()
        self.client = Client(self.address, TOKEN)

    def kill(self) -> None:
        self.process.kill()
        self._over()

    def terminate(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self._over()

    def _over(self) -> int:
        code = self.process.wait(20)
        for stream in (self.process.stdout, self.process.stderr):
            stream.close()
        return code


@contextmanager
def serving(folder: Path):
    own = Serving(folder)
    try:
        yield own
    finally:
        if own.process.poll() is None:
            own.kill()
