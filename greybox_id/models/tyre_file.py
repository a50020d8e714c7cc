"""Tyre property files (.tir) of the Magic Formula 5.2, 6.1 and 6.2: lines KEY = number under [SECTIONS].

Only pure lateral slip at zero camber and nominal pressure is read, at a wheel load. Source: Pacejka, Tire and Vehicle
Dynamics, 3rd ed., Sec. 4.3.2, Eq. 4.E19 to 4.E30; 5.2 is the special case PKY4 = 2 without pressure.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import atan, hypot, sin
from pathlib import Path

from ..base.errors import BadInput
from ..base.files import small_file
from .parameter import Stated

LARGEST_NUMBER = 1e100
FORMATS = {5: "5.2", 6: "5.2", 21: "5.2", 51: "5.1", 52: "5.2", 60: "6.0", 61: "6.1", 62: "6.2"}
"""FITTYP -> version of the Magic Formula."""
DEFAULTS = {
    "PKY2": 1.0, "PKY4": 2.0, "PEY1": 0.0, "PEY2": 0.0, "PDY2": 0.0, "PHY1": 0.0, "PHY2": 0.0, "PVY1": 0.0, "PVY2": 0.0,
    "LFZO": 1.0, "LCY": 1.0, "LMUY": 1.0, "LEY": 1.0, "LKY": 1.0, "LHY": 1.0, "LVY": 1.0,
}  # fmt: skip
"""Values of coefficients that a file may omit."""
NEEDED = ("FNOMIN", "PCY1", "PDY1", "PKY1")
SIDES = ("left", "right", "symmetric")
LOADS = (0.5, 1.5)
"""Range of wheel loads in bends over the nominal load: half of the load is transferred to the other side."""
DIGITS = 12
"""Significant digits of computed coefficients: few enough that writing and reading a file returns the same ones."""
BELT = 0.3
"""Standard deviation of a road's friction relative to the test belt's. Belts are clean and covered with abrasive paper,
which has more grip than a road: a road's friction, two thirds of the belt's, is about one standard deviation less."""
TELLING = 0.01
"""Relative change with load below which no standard deviation of a coefficient is derived from the load."""
_LINE = re.compile(r"\s*([A-Za-z_]\w{0,63})\s*=\s*('[^']*'|\"[^\"]*\"|[^\s$!]+)")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d{1,4})?")


@dataclass(frozen=True)
class PureLateral:
    """F_y = F_z (D sin(C atan(B a - E (B a - atan(B a)))) + S_v), a = alpha + S_h; positive for positive slip angles.

    Attributes
    ----------
    B, C, D, E : 1/rad, 1, 1, 1.
    S_h, S_v : rad, 1.
    """

    B: float
    C: float
    D: float
    E: float
    S_h: float
    S_v: float

    def force(self, alpha: float, load: float) -> float:
        """F_y, N, at a slip angle, rad, and a load, N."""
        slip = self.B * (alpha + self.S_h)
        return load * (self.D * sin(self.C * atan(slip - self.E * (slip - atan(slip)))) + self.S_v)


@dataclass(frozen=True)
class TyreFile:
    """A tyre property file.

    Attributes
    ----------
    path : of the file.
    version : of the Magic Formula, such as "6.1".
    numbers : KEY -> number.
    side : the side for which the tyre was measured: "left", "right" or "symmetric"; empty if not stated.
    """

    path: str
    version: str
    numbers: Mapping[str, float]
    side: str = ""

    @property
    def nominal_load(self) -> float:
        """LFZO FNOMIN, N, the load to which coefficients refer."""
        return self._of("LFZO") * self.numbers["FNOMIN"]

    @property
    def ignored(self) -> tuple[str, ...]:
        """Contents of the file that a single track does not use, by subject."""
        held = {
            "longitudinal slip": ("PCX", "PDX", "PEX", "PKX", "PHX", "PVX"),
            "combined slip": ("RB", "RC", "RE", "RH", "RV"),
            "aligning, overturning and rolling moments": ("QB", "QC", "QD", "QE", "QH", "QS"),
            "camber": ("PDY3", "PEY4", "PEY5", "PKY3", "PKY5", "PKY6", "PKY7", "PHY3", "PVY3", "PVY4"),
            "asymmetric curvature": ("PEY3",), "inflation pressure": ("PPX", "PPY", "PPZ", "IP"),
            "relaxation": ("PTX", "PTY"), "turn slip": ("PDXP", "PKYP", "PDYP", "PHYP"),
        }  # fmt: skip
        return tuple(
            what
            for what, starts in held.items()
            if any(value and key.startswith(starts) for key, value in self.numbers.items())
        )

    def at(self, load: float | None = None) -> PureLateral:
        """Coefficients at a wheel load, N, by default the nominal one. Raises `BadInput` if they are degenerate."""
        nominal = self.nominal_load
        F_z = nominal if load is None else load
        df = (F_z - nominal) / nominal
        C = self._of("PCY1") * self._of("LCY")
        D = (self._of("PDY1") + self._of("PDY2") * df) * self._of("LMUY")
        E = (self._of("PEY1") + self._of("PEY2") * df) * self._of("LEY")
        scale = self._of("PKY2")
        if not (C * D and scale and F_z > 0):
            raise BadInput(
                f"{self.path}: at a load of {F_z:g} N, PCY1, the friction (PDY1, PDY2), PKY2 or a scale "
                f"factor is zero, or the load is not above zero; correct the file."
            )
        K = self._of("PKY1") * nominal * sin(self._of("PKY4") * atan(F_z / nominal / scale)) * self._of("LKY")
        S_h = (self._of("PHY1") + self._of("PHY2") * df) * self._of("LHY")
        S_v = (self._of("PVY1") + self._of("PVY2") * df) * self._of("LVY") * self._of("LMUY")
        if not K:
            raise BadInput(f"{self.path}: PKY1 and LKY give a cornering stiffness of zero; correct the file.")
        # The curve's sign is a convention: slip angles in such files often have the opposite sign.
        values = (abs(K / (C * D * F_z)), abs(C), abs(D), E, S_h, S_v if K > 0 else -S_v)
        if not all(abs(value) < LARGEST_NUMBER for value in values):
            raise BadInput(
                f"{self.path}: the coefficients at a load of {F_z:g} N are implausibly large; correct the file."
            )
        return PureLateral(*(float(f"{value:.{DIGITS}g}") for value in values))

    def stated(self) -> dict[str, Stated]:
        """B, C, D, E and the shifts of both axles at the nominal load, as a vehicle file states them.

        Their standard deviation is half of their change between `LOADS`; none is stated if that is negligible, and the
        number is then only an initial value. The uncertainty of the belt's friction is added to that of D, and to that
        of B as well, since the stiffness B C D depends least on the road.
        """
        here, apart = self.at(), [self.at(share * self.nominal_load) for share in LOADS]
        source = f"{Path(self.path).name}: Magic Formula {self.version} at {self.nominal_load:g} N"
        result = {}
        for letter in "BCDE":
            value, sd = getattr(here, letter), abs(getattr(apart[1], letter) - getattr(apart[0], letter)) / 2
            if letter in "BD":
                sd = hypot(sd, BELT * abs(value))
            for suffix in "fr":
                result[f"{letter}_{suffix}"] = Stated(value, sd if sd > TELLING * abs(value) else None, source=source)
        return result | self._shifts(here)

    def _shifts(self, here: PureLateral) -> dict[str, Stated]:
        """Shifts of an axle: zero with the size of one tyre's shift as uncertainty; none for symmetric tyres.

        Ply steer keeps its side when a tyre is reversed, conicity does not; no file states which of both a shift is, or
        how tyres are mounted.
        """
        if self.side == "symmetric":
            return {}
        source = (
            f"{Path(self.path).name}: shift of one {self.side or 'single'} tyre; it cancels between a left and "
            "a mirrored right tyre"
        )
        sizes = {"S_h": abs(here.S_h), "S_v": abs(here.S_v)}
        return {
            f"{name}_{axle}": Stated(0.0, size, source=source) for name, size in sizes.items() if size for axle in "fr"
        }

    def _of(self, key: str) -> float:
        return self.numbers.get(key, DEFAULTS.get(key, 0.0))


def read_tyre_file(path: str | Path) -> TyreFile:
    """Read a tyre property file.

    Raises
    ------
    BadInput : it cannot be read, is not such a file, is too large, or a value in it is not a number.
    """
    return parse_tyre_file(small_file(path, "tyre property file").decode("latin-1"), str(path))


def parse_tyre_file(text: str, path: str) -> TyreFile:
    """A tyre property file from its text. Raises `BadInput` as `read_tyre_file` does."""
    numbers: dict[str, float] = {}
    words: dict[str, str] = {}
    for count, line in enumerate(text.splitlines(), 1):
        result = _LINE.match(line)
        if result is None:
            continue
        key, value = result[1].upper(), result[2]
        if value[0] in "'\"":
            words[key] = value[1:-1].strip()
        elif _NUMBER.fullmatch(value):
            number = float(value.translate(str.maketrans("dD", "ee")))
            if not abs(number) < LARGEST_NUMBER:
                raise BadInput(f"{path}: line {count}: {key} = {value:.40} is too large; mend it.")
            numbers[key] = number
        elif key in NEEDED or key in DEFAULTS:
            raise BadInput(f"{path}: line {count}: {key} = {value:.40} is not a number; correct it.")
    missing = [key for key in NEEDED if key not in numbers]
    if missing:
        raise BadInput(
            f"{path}: there is no {', '.join(missing)}; a tyre property file (.tir) of the Magic Formula 5.2, 6.1 or "
            "6.2 has them. Export it again from the tyre's tool."
        )
    if numbers["FNOMIN"] <= 0 or numbers.get("LFZO", 1.0) <= 0:
        raise BadInput(f"{path}: FNOMIN and LFZO must be above zero; mend them.")
    unit = words.get("FORCE", "newton").lower(), words.get("ANGLE", "radians").lower()
    if unit[0] not in ("newton", "n") or not unit[1].startswith("rad"):
        raise BadInput(f"{path}: its [UNITS] are {unit[0]:.20} and {unit[1]:.20}; convert it to newton and radians.")
    side = words.get("TYRESIDE", "").lower()
    made = TyreFile(path, _version(numbers, words), numbers, side if side in SIDES else "")
    made.at()
    return made


def _version(numbers: Mapping[str, float], words: Mapping[str, str]) -> str:
    known = numbers.get("FITTYP")
    if known in FORMATS:
        return FORMATS[int(known)]
    if words.get("PROPERTY_FILE_FORMAT", "").upper() == "PAC2002":
        return "5.2"
    return "6.1" if "PPY1" in numbers or "PKY4" in numbers else "5.2"
