"""The controller in C: a model exported by greybox, compiled together with c/, and called from here."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from wishes import Wishes

from greybox_id.base.errors import BadInput
from greybox_id.export.equations import Equations
from greybox_id.export.subject import Subject
from greybox_id.export.verb import export
from greybox_id.models.motion_model import MotionModel
from greybox_lab.driving.racing.track import RaceTrack

Row = NDArray[np.float64]

SOURCES = Path(__file__).parent / "c"
SWEEPS = 2
"""A decision: one is a real-time iteration, the second settles what a bound upset."""
HARDNESS = 1e4
"""Weight of squared excess over soft bounds; the program in Python has a linear one as well."""

_double, _int, _pair = ctypes.c_double, ctypes.c_int, ctypes.c_double * 2
_column = ctypes.POINTER(_double)


class _Settings(ctypes.Structure):
    """`nmpc_settings` of c/nmpc.h, for a model with two inputs."""

    _fields_ = (
        *(("period", _double), ("late", _pair), ("front", _double), ("rear", _double)),
        *(("stages", _int), ("sweeps", _int), ("path", _double), ("course", _double), ("speed", _double)),
        *(("rates", _pair), ("low", _pair), ("high", _pair), ("fastest", _pair)),
        *(("slip", _double), ("half_width", _double), ("beyond", _double)),
        *(("curvature", _column), ("wanted", _column), ("points", _int), ("spacing", _double)),
    )


class CDriver:
    """The controller of c/nmpc.c for one model on one track.

    Parameters
    ----------
    model : that is believed; it is exported and compiled.
    period : s, between commands.
    track, wishes : see `controller.Controller`.
    v_x : m/s, at which it starts.
    folder : for the exported model and the library.

    Attributes
    ----------
    seconds, failures : see `lap.Driver`.
    """

    def __init__(
        self, model: MotionModel, period: float, track: RaceTrack, wishes: Wishes, v_x: float, folder: Path
    ) -> None:
        self.seconds: list[float] = []
        self.failures = 0
        self._library = library(model, folder)
        late = Equations(model, moving=()).shifts()
        self._columns = [np.ascontiguousarray(column, float) for column in (track.curvature, track.speed)]
        curvature, wanted = (column.ctypes.data_as(_column) for column in self._columns)
        settings = _Settings(
            period, _pair(*(late.get(f"delay of {name}", 0.0) for name in model.inputs)),
            float(model["l_f"].array), float(model["l_r"].array), wishes.stages, SWEEPS,
            wishes.path, wishes.course, wishes.speed, _pair(*wishes.rates),
            _pair(*wishes.low), _pair(*wishes.high), _pair(*wishes.fastest),
            wishes.slip, track.half_width, HARDNESS, curvature, wanted, len(track.s), track.spacing,
        )  # fmt: skip
        self._memory = ctypes.create_string_buffer(self._library.nmpc_size())
        if self._library.nmpc_start(self._memory, ctypes.byref(settings), _double(v_x), _double(0.0)) != 0:
            raise BadInput("The controller in C takes no horizon or delay that long; see NMPC_STAGES, NMPC_LATE.")

    def decide(self, measured: Mapping[str, float], s: float, e_y: float, e_psi: float) -> Row:
        """Commands of the next period; see `lap.Driver`."""
        motion = (_double * 3)(*(measured[name] for name in ("v_x", "v_y", "yaw_rate")))
        commands = _pair()
        begun = time.thread_time()
        found = self._library.nmpc_decide(self._memory, motion, _double(s), _double(e_y), _double(e_psi), commands)
        self.seconds.append(time.thread_time() - begun)
        self.failures += found != 0
        return np.array(commands)


def library(model: MotionModel, folder: Path) -> ctypes.CDLL:
    """The model exported to C and compiled together with the controller."""
    compiler = shutil.which("cc")
    if compiler is None:
        raise BadInput("There is no C compiler (cc) here; the controller in C needs one.")
    export(Subject(model, "car"), "c", folder / "car")
    target = folder / "nmpc.so"
    sources = [str(folder / "car" / "car.c"), *map(str, sorted(SOURCES.glob("*.c")))]
    flags = ["-std=c99", "-O2", "-shared", "-fPIC", f"-I{folder / 'car'}", f"-I{SOURCES}"]
    subprocess.run([compiler, *flags, *sources, "-o", str(target), "-lm"], check=True)
    loaded = ctypes.CDLL(str(target.resolve()))
    loaded.nmpc_size.restype = ctypes.c_size_t
    return loaded
