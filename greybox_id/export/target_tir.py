"""Target `tir`: tyre property files of the Magic Formula 5.2, one per axle, isotropic from B, C, D and E.

Longitudinal slip has the lateral curve's coefficients. Source: Pacejka, Tire and Vehicle Dynamics, 3rd ed., Sec. 4.3.2.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import atan, sin
from typing import NamedTuple

from ..base.errors import BadInput
from ..models.tyre_file import DIGITS
from .c.naming import one_line
from .single_track_numbers import HELD, Axle, single_track_of, value_of, without_form_error
from .subject import KeyOrigin, Subject

RADIUS = 0.3
"""Unloaded radius, m, where the model has none: it scales relaxation lengths, which are divided by it again."""
BEYOND_LOAD = 1000.0
"""PKY2, load of the largest stiffness over the nominal load. Large, since stiffness is proportional to load in the
models: at twice the nominal load, sin(2 atan(x)) = 2 x / (1 + x^2), x = 2 / BEYOND_LOAD, is linear within 4e-6."""
HOLDS = (*HELD, "tyre_relaxation")


NOT_KNOWN = "not known of this vehicle"


class TirKey(NamedTuple):
    """A line of the file."""

    section: str
    key: str
    value: float
    about: str
    behind: str = ""
    why: str = ""


def files(subject: Subject) -> Mapping[str, bytes]:
    """`NAME_front.tir`, `NAME_rear.tir`. Raises `BadInput` for a model without Pacejka's tyres."""
    return {file: _text(subject, where, lines).encode() for file, (where, lines) in _files(subject).items()}


def cautions(subject: Subject) -> list[str]:
    """Sentences on what these files lack."""
    lost = [name for name in subject.model.effects if name not in HOLDS]
    result = [f"A tyre file has no entry for {', '.join(lost)}, which is left out."] if lost else []
    result += without_form_error(subject)
    result.append(
        "Longitudinal and combined slip have the coefficients of the lateral curve: nothing else is known of them."
    )
    return result


def origins(subject: Subject) -> list[KeyOrigin]:
    """Origin of each line."""
    return [
        KeyOrigin(file, line.key, line.value, line.behind, line.why)
        for file, (_, lines) in _files(subject).items()
        for line in lines
    ]


def _files(subject: Subject) -> dict[str, tuple[str, list[TirKey]]]:
    numbers = single_track_of(subject)
    return {
        f"{subject.name}_front.tir": ("front", _lines(subject, numbers.front, "f")),
        f"{subject.name}_rear.tir": ("rear", _lines(subject, numbers.rear, "r")),
    }


def _lines(subject: Subject, axle: Axle, suffix: str) -> list[TirKey]:
    curve = axle.pacejka
    if curve is None:
        raise BadInput(
            f"{subject.model.name} has {subject.model.settings.get('tyre', 'other')} tyres; a .tir file holds "
            "Pacejka's formula. Fit the tyre pacejka, or export for another target."
        )
    model = subject.equations.model
    B, C, D, E = (float(f"{value:.{DIGITS}g}") for value in curve)
    load, radius = axle.load / 2, value_of(model, "wheel_radius")
    stated = None if subject.vehicle is None else subject.vehicle.values.get("wheel_radius")
    if radius is None and stated is not None:
        radius = stated.value
    shift_h, shift_v = value_of(model, f"S_h_{suffix}") or 0.0, value_of(model, f"S_v_{suffix}") or 0.0
    payload, k = value_of(model, "mass_change") or 1.0, value_of(model, "load_sensitivity") or 0.0
    sensitivity = (
        k * payload / (1 - k * (payload - 1))
    )  # the model's coefficient refers to the load without payload, the file's to the load with it
    relaxation = value_of(model, "tyre_relaxation") or 0.0
    stiff, peak = f"B_{suffix} C_{suffix} D_{suffix}", _with(subject, f"D_{suffix}", "grip_scale", "load_sensitivity")
    slope = _with(subject, stiff, {"f": "front_stiffness", "r": "rear_stiffness"}[suffix], "grip_scale")
    weight = _with(subject, "m, l_f, l_r: half of the axle's static load", "mass_change", "cog_shift")
    R = RADIUS if radius is None else radius
    sized = {"behind": "wheel_radius"} if radius is not None else {"why": NOT_KNOWN}
    none = {"why": "no parameter or effect of the model gives this value"}
    isotropic, with_load = "; isotropic, that of the lateral curve", "change of friction with load"
    steepest = -B * C * D / sin(2 * atan(1 / BEYOND_LOAD))
    grows = "far: the model's stiffness grows with load"
    length = {"behind": "tyre_relaxation"} if relaxation else {"why": "the model's tyres do not relax"}
    return [
        TirKey("MODEL", "FITTYP", 6.0, "Magic Formula 5.2", why="what is written"),
        TirKey("MODEL", "LONGVL", 15.0, "m/s, reference speed", **none),
        TirKey("DIMENSION", "UNLOADED_RADIUS", R, "m", **sized),
        TirKey("DIMENSION", "WIDTH", 0.2, "m", **none),
        TirKey("DIMENSION", "RIM_RADIUS", 0.6 * R, "m", **none),
        TirKey("VERTICAL", "VERTICAL_STIFFNESS", load / (0.05 * R), "N/m: a twentieth of the radius", **none),
        TirKey("VERTICAL", "VERTICAL_DAMPING", 0.0, "N s/m", **none),
        TirKey("VERTICAL", "FNOMIN", load, "N, nominal wheel load", weight),
        TirKey("LONG_SLIP_RANGE", "KPUMIN", -1.5, "", **none),
        TirKey("LONG_SLIP_RANGE", "KPUMAX", 1.5, "", **none),
        TirKey("SLIP_ANGLE_RANGE", "ALPMIN", -1.5, "rad", **none),
        TirKey("SLIP_ANGLE_RANGE", "ALPMAX", 1.5, "rad", **none),
        TirKey("INCLINATION_ANGLE_RANGE", "CAMMIN", -0.3, "rad", **none),
        TirKey("INCLINATION_ANGLE_RANGE", "CAMMAX", 0.3, "rad", **none),
        TirKey("VERTICAL_FORCE_RANGE", "FZMIN", 0.0, "N", **none),
        TirKey("VERTICAL_FORCE_RANGE", "FZMAX", 4 * load, "N", **none),
        *(TirKey("SCALING_COEFFICIENTS", key, 1.0, "", **none) for key in SCALES),
        TirKey("LONGITUDINAL_COEFFICIENTS", "PCX1", C, f"shape{isotropic}", f"C_{suffix}"),
        TirKey("LONGITUDINAL_COEFFICIENTS", "PDX1", D, f"friction{isotropic}", peak),
        TirKey("LONGITUDINAL_COEFFICIENTS", "PDX2", 0.0 - sensitivity * D, with_load + isotropic, "load_sensitivity"),
        TirKey("LONGITUDINAL_COEFFICIENTS", "PEX1", E, f"curvature{isotropic}", f"E_{suffix}"),
        TirKey("LONGITUDINAL_COEFFICIENTS", "PKX1", B * C * D, f"slip stiffness / load{isotropic}", slope),
        TirKey("LATERAL_COEFFICIENTS", "PCY1", C, "shape", f"C_{suffix}"),
        TirKey("LATERAL_COEFFICIENTS", "PDY1", D, "friction at the nominal load", peak),
        TirKey("LATERAL_COEFFICIENTS", "PDY2", 0.0 - sensitivity * D, with_load, "load_sensitivity"),
        TirKey("LATERAL_COEFFICIENTS", "PEY1", E, "curvature", f"E_{suffix}"),
        TirKey("LATERAL_COEFFICIENTS", "PKY1", steepest, "largest cornering stiffness / nominal load", slope),
        TirKey("LATERAL_COEFFICIENTS", "PKY2", BEYOND_LOAD, "load of that stiffness / nominal load", why=grows),
        TirKey("LATERAL_COEFFICIENTS", "PHY1", shift_h, "rad, horizontal shift", f"S_h_{suffix}"),
        TirKey("LATERAL_COEFFICIENTS", "PVY1", 0.0 - shift_v, "vertical shift", f"S_v_{suffix}"),
        TirKey("LATERAL_COEFFICIENTS", "PTY1", relaxation / R, "relaxation length / radius", **length),
        TirKey("LATERAL_COEFFICIENTS", "PTY2", 1.0, "load of the longest relaxation length", **none),
    ]  # fmt: skip


SCALES = ("LFZO", "LCX", "LMUX", "LEX", "LKX", "LHX", "LVX", "LCY", "LMUY", "LEY", "LKY", "LHY", "LVY", "LSGAL")


def _with(subject: Subject, words: str, *effects: str) -> str:
    return ", ".join([words, *(name for name in effects if name in subject.model.effects)])


def _text(subject: Subject, where: str, lines: list[TirKey]) -> str:
    head = [
        "[MDI_HEADER]", "FILE_TYPE = 'tir'", "FILE_VERSION = 3.0", "FILE_FORMAT = 'ASCII'",
        f"! {one_line(f'{subject.model.about}, {where} axle, from {subject.source}')}; written by greybox-id.",
        "! Longitudinal slip is not known: it has the coefficients of the lateral curve.", "[UNITS]",
        "LENGTH = 'meter'", "FORCE = 'newton'", "ANGLE = 'radians'", "MASS = 'kg'", "TIME = 'second'",
        "[MODEL]", "PROPERTY_FILE_FORMAT = 'PAC2002'", "TYRESIDE = 'LEFT'", "USE_MODE = 4",
    ]  # fmt: skip
    section = "MODEL"
    for line in lines:
        if line.section != section:
            section = line.section
            head.append(f"[{section}]")
        note = "; ".join(filter(None, [line.about, line.why if line.why.startswith(NOT_KNOWN) else ""]))
        head.append(f"{line.key} = {line.value!r}{f'  $ {note}' if note else ''}")
    return "\n".join([*head, ""])
