"""A unit's binary for this machine: the sources compiled with what compiler there is, for any processor of its kind."""

from __future__ import annotations

import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

from ...base.errors import BadInput
from ...engine.compiler import CannotCompile, compiler_command

FLAGS = ("-std=c99", "-O2", "-fPIC", "-fvisibility=hidden", "-ffp-contract=off", "-w")
SUFFIX = {"linux": ".so", "darwin": ".dylib", "win32": ".dll"}


def place(version: int) -> str:
    """The folder of binaries for this machine, as FMI 2 or 3 calls it."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    system = {"linux": "linux", "darwin": "darwin", "win32": "windows"}.get(sys.platform, sys.platform)
    if version == 2 and machine == "x86_64":
        return {"linux": "linux64", "darwin": "darwin64", "windows": "win64"}.get(system, f"{machine}-{system}")
    return f"{machine}-{system}"


def binaries(sources: Mapping[int, Mapping[str, bytes]], compiled: Mapping[int, Sequence[str]]) -> dict[int, bytes]:
    """Libraries by version of FMI, their bytes the same for the same sources and compiler.

    Parameters
    ----------
    sources : version -> name of file -> content, headers among them; what is the same is compiled once.
    compiled : version -> names of those that are compiled.

    Raises
    ------
    CannotCompile : there is no compiler, or it failed.
    BadInput : there is no room to compile in.
    """
    try:
        return _made(sources, compiled)
    except OSError as error:
        raise BadInput(f"{gettempdir()}: no unit can be compiled there: {error.strerror}.") from error


def _made(sources: Mapping[int, Mapping[str, bytes]], compiled: Mapping[int, Sequence[str]]) -> dict[int, bytes]:
    with TemporaryDirectory(prefix="greybox-id-") as folder:
        made, objects = dict[int, bytes](), dict[bytes, str]()
        for version, texts in sources.items():
            for name, content in texts.items():
                (Path(folder) / name).write_bytes(content)
            linked = []
            for name in compiled[version]:
                if texts[name] not in objects:
                    objects[texts[name]] = f"{len(objects)}.o"
                    plain = f"-DFMI{version}_OVERRIDE_FUNCTION_PREFIX"
                    _called(folder, *FLAGS, plain, "-c", name, "-o", objects[texts[name]])
                linked.append(objects[texts[name]])
            _called(folder, "-shared", *linked, "-o", "unit", "-lm")
            made[version] = (Path(folder) / "unit").read_bytes()
        return made


def _called(folder: str, *words: str) -> None:
    command = [*compiler_command(), *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise CannotCompile(f"The C compiler {command[0]} failed: {done.stderr.strip():.400}")


def suffix() -> str:
    """What shared libraries of this system end in."""
    return SUFFIX.get(sys.platform, ".so")
