"""Target `fmu`: the exported C as functional mock-up units of FMI 2.0 and 3.0, with sources and binary.

The binary is compiled for this machine's system and processor family with any available compiler.
"""

from __future__ import annotations

import hashlib
import io
import platform
import subprocess
import sys
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from importlib import resources
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

from ..base.errors import BadInput
from ..base.version import __version__
from ..engine.compiler import CannotCompile, compiler_command
from ..engine.motion.schedule import STABLE
from .c.motion import MotionC
from .c.naming import c_comment, c_string, constant, number, one_line
from .equations import Equations, Named
from .fmu.description import Description, Steps, continuous, steps_of, variables_of
from .subject import KeyOrigin, Subject
from .template import filled

FLAGS = ("-std=c99", "-O2", "-fPIC", "-fvisibility=hidden", "-ffp-contract=off", "-w")
SUFFIX = {"linux": ".so", "darwin": ".dylib", "win32": ".dll"}


def place(version: int) -> str:
    """The folder of binaries for this machine, in the notation of FMI 2 or 3."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    system = {"linux": "linux", "darwin": "darwin", "win32": "windows"}.get(sys.platform, sys.platform)
    if version == 2 and machine == "x86_64":
        return {"linux": "linux64", "darwin": "darwin64", "windows": "win64"}.get(system, f"{machine}-{system}")
    return f"{machine}-{system}"


def binaries(sources: Mapping[int, Mapping[str, bytes]], compiled: Mapping[int, Sequence[str]]) -> dict[int, bytes]:
    """Libraries by version of FMI; the same sources and compiler give the same bytes.

    Parameters
    ----------
    sources : version -> name of file -> content, including headers; common files are compiled once.
    compiled : version -> names of the files to compile.

    Raises
    ------
    CannotCompile : there is no compiler, or it failed.
    BadInput : the temporary folder cannot be written.
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
    """Suffix of shared libraries on this system."""
    return SUFFIX.get(sys.platform, ".so")


REMEMBERED = 4096
"""Commands and starts of segments that a unit stores: 0.5 s of steps of a quarter of a millisecond, and boundaries."""
VERSIONS = {2: "", 3: "_fmi3"}
"""Version of FMI -> suffix of the file's name."""
NOBODY = Named("", "")
"""Dummy last entry of tables, since C has no empty arrays."""
EPOCH = (1980, 1, 1, 0, 0, 0)
"""Earliest time that a zip archive can store."""
MODE = 0o644 << 16
UNSIGNED = "{TOKEN}"
"""Placeholder of the token until all its sources are known."""
SHARED = ("instance.h", "instance.c", "shared.h")


def files(subject: Subject) -> Mapping[str, bytes]:
    """`NAME.fmu` of FMI 2.0 and `NAME_fmi3.fmu` of FMI 3.0. Raises `BadInput` for models other than motion models."""
    steps = steps_of(subject.equations)
    title = f"{subject.model.about} ({subject.model.name}), from {subject.source or 'Python'}"
    about = Description(
        subject.name, one_line(title), "", variables_of(subject, steps), continuous(subject.equations), steps.longest
    )
    code, described, sources = _code(subject, title), dict[int, Description](), dict[int, dict[str, bytes]]()
    for version in VERSIONS:
        shared = {name: _shipped(name) for name in (*SHARED, f"fmi{version}.c")}
        model = _model(subject, steps, UNSIGNED)
        token = _token(version, *code.values(), *shared.values(), model.encode(), about.model(version).encode())
        described[version] = replace(about, token=token)
        sources[version] = {**code, **shared, "model.h": model.replace(UNSIGNED, token).encode()}
    try:
        made = binaries(sources, {version: item.sources(version) for version, item in described.items()})
    except CannotCompile:  # reported by `cautions`
        made = {}
    return {
        f"{subject.name}{ending}.fmu": archive(_held(subject.name, described[version], sources[version], made, version))
        for version, ending in VERSIONS.items()
    }


def cautions(subject: Subject) -> list[str]:
    """Sentences on what these files lack."""
    result = []
    try:
        compiler_command()
    except CannotCompile as error:
        result.append(f"{error} The units hold sources only; who imports them has to compile them.")
    model = subject.equations.model
    ahead = [name for name, seconds in subject.equations.shifts().items() if seconds < 0]
    if ahead:
        result.append(f"A unit cannot read future inputs: {', '.join(ahead)} is below zero and set to zero.")
    scatter = [name for name in ("timestamp_jitter", "dropped_samples") if name in model.effects]
    if scatter:
        result.append(f"{', '.join(scatter)} belongs to recordings, not to the motion, and is left out of the unit.")
    return result


def origins(subject: Subject) -> list[KeyOrigin]:
    """Every parameter of the unit, and its origin."""
    names = {item.name.removeprefix("parameters."): item for item in variables_of(subject, steps_of(subject.equations))}
    return [
        KeyOrigin(f"{subject.name}.fmu", f"parameters.{p.name}", names[p.name].start, p.name)
        for p in subject.model.parameters
        if p.name in names
    ]


def _code(subject: Subject, title: str) -> dict[str, bytes]:
    """The model's C sources."""
    line = c_comment(f"{subject.name}: {title}, greybox-id {__version__}.")
    unused = ("step_jacobian", "step_by_p") + (() if continuous(subject.equations) else ("ode_jacobian",))
    written = MotionC(subject.name, subject.equations, line, REMEMBERED, unused)
    return {f"{subject.name}.h": written.header.encode(), f"{subject.name}.c": written.source.encode()}


def _held(
    name: str, about: Description, sources: Mapping[str, bytes], made: Mapping[int, bytes], version: int
) -> dict[str, bytes]:
    """The files of a unit."""
    held = {"modelDescription.xml": about.model(version).encode()}
    held |= {f"sources/{file}": content for file, content in sources.items()}
    held["sources/buildDescription.xml"] = about.build(version).encode()
    if version in made:
        held[f"binaries/{place(version)}/{name}{suffix()}"] = made[version]
    return held


def _token(version: int, *parts: bytes) -> str:
    """Identifier of a unit, equal for equal units, in the form of a GUID."""
    digits = hashlib.sha256(b"\0".join((str(version).encode(), *parts))).hexdigest()
    return f"{{{digits[:8]}-{digits[8:12]}-{digits[12:16]}-{digits[16:20]}-{digits[20:32]}}}"


@lru_cache
def _shipped(name: str) -> bytes:
    return resources.files(__package__).joinpath("fmu", "sources", name).read_bytes()


def _model(subject: Subject, steps: Steps, token: str) -> str:
    """`model.h`: data of this unit for the sources that all units share."""
    e, name = subject.equations, subject.name
    late = {signal: k for k, signal in enumerate(e.late)}
    delays = {signal: k for k, signal in enumerate(e.delayed)}
    speed, kind = _speed(e)
    return filled(
        "fmu_model.h", name, TITLE=c_comment(name), TOKEN=c_string(token), MOVING=len(e.model.states), PAST=REMEMBERED,
        SETTLES=int(e.settles), CONTINUOUS=int(continuous(e)), DELAYED=len(e.delayed), LATE=len(e.late),
        COMMANDS=f"#define MODEL_COMMANDS {constant(name, 'COMMANDS')}" if e.delayed else "",
        START_X=", ".join(["0.0"] * len(e.states)), START_U=", ".join(["0.0"] * (len(e.inputs) + 1)),
        DELAY_OF=", ".join(str(delays.get(i.name, -1)) for i in (*e.inputs, NOBODY)),
        LATENCY_OF=", ".join(str(late.get(i.name, -1)) for i in (*e.outputs, NOBODY)),
        LONGEST=number(steps.longest), STABLE=number(STABLE), STIFF=number(steps.stiff),
        BY_SPEED=number(steps.by_speed), SLOWEST=number(steps.slowest), SPEED_IS_STATE=int(kind == "state"),
        SPEED_IS_INPUT=int(kind == "input"), SPEED=speed,
    )  # fmt: skip


def _speed(e: Equations) -> tuple[int, str]:
    """Index of the speed, and whether it is a state or an input."""
    for kind, entries in (("state", e.states), ("input", e.inputs)):
        for k, entry in enumerate(entries):
            if entry.name == "v_x":
                return k, kind
    return 0, ""


def archive(files: Mapping[str, bytes]) -> bytes:
    """A zip archive of files, path -> content; equal contents give equal bytes."""
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as made:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.compress_type, entry.external_attr, entry.create_system = zipfile.ZIP_DEFLATED, MODE, 3
            made.writestr(entry, files[name])
    return held.getvalue()
