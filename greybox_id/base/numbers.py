"""Numbers, units and names as printed: with as many digits as the uncertainty allows."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from .signals import SIGNALS

_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
MOST_DIGITS = 7
"""Largest number of significant digits, however small the standard deviation: no sensor resolves more."""
SMALLEST, LARGEST = -3, 5
"""Powers of ten between which numbers are written without an exponent."""


def pretty_unit(unit: str) -> str:
    """A unit in pint's spelling as printed: m/s^2 as m/s², no unit as a dash."""
    return "–" if unit in ("", "1") else raised(unit)


def raised(text: str) -> str:
    """Integer powers as superscripts: r^2 as r²."""
    return re.sub(r"\^(-?\d+)", lambda match: match[1].translate(_RAISED), text)


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """A number to `digits` significant digits, with its unit."""
    return with_unit(number(value, digits), unit)


def with_unit(shown: str, unit: str) -> str:
    """A printed number followed by its unit, if it has one."""
    return shown if unit in ("", "1") else f"{shown} {pretty_unit(unit)}"


def signed(value: float, digits: int = 3) -> str:
    """A number with its sign: +0.20, −0.20."""
    return f"{'+' if value > 0.0 else ''}{number(value, digits)}"


def number(value: float, digits: int = 3) -> str:
    """A number to `digits` significant digits."""
    if not math.isfinite(value):
        return "–" if math.isnan(value) else ("∞" if value > 0 else "−∞")
    if value == 0.0:
        return "0"
    power = _power(float(f"{value:.{digits - 1}e}"))  # of what is shown: 9.997 is 10.0
    if SMALLEST <= power < LARGEST:
        return _minus(f"{value:.{max(0, digits - 1 - power)}f}")
    mantissa = f"{value:.{digits - 1}e}".partition("e")[0]  # no division: 10^-324 is zero
    return f"{_minus(mantissa)}·10{_raised(power)}"


def exact(value: float, digits: int = 3) -> str:
    """A number without trailing zeros, for exact values such as a factor between units."""
    shown, times, power = number(value, digits).partition("·")
    return (shown.rstrip("0").rstrip(".") if "." in shown else shown) + times + power


def rmse(value: float) -> str:
    """A root mean square error of predictions, to two digits; infinite where they diverge."""
    return "diverges" if value == math.inf else number(value, 2)


def with_sd(value: float, sd: float, digits: int = 2) -> str:
    """Estimate ± standard deviation, to `digits` significant digits of the standard deviation."""
    if not (math.isfinite(value) and math.isfinite(sd) and sd > 0.0):
        return number(value)
    shown = together(value, sd, by=sd * 10 ** (2 - digits))
    if shown.power:
        return f"({shown.words[0]} ± {shown.words[1]})·10{_raised(shown.power)}"
    return f"{shown.words[0]} ± {shown.words[1]}"


def short_with_sd(value: float, sd: float) -> str:
    """Value ± standard deviation to one significant digit of the latter, two if it begins with 1 or 2."""
    leading = sd / 10.0 ** _power(sd) if math.isfinite(sd) and sd > 0.0 else 1.0
    return with_sd(value, sd, 2 if leading < 3.0 else 1)


def interval(low: float, high: float, sd: float) -> str:
    """An interval, to two significant digits of its standard deviation."""
    if not (math.isfinite(sd) and sd > 0.0):
        return "–"
    shown = together(low, high, by=sd)
    times = f"·10{_raised(shown.power)}" if shown.power else ""
    return f"[{shown.words[0]}, {shown.words[1]}]{times}"


def with_interval(value: float, low: float, high: float, sd: float) -> str:
    """An estimate with its interval, to two significant digits of its standard deviation."""
    if not (math.isfinite(sd) and sd > 0.0):
        return number(value)
    shown = together(value, low, high, by=sd)
    times = f"·10{_raised(shown.power)}" if shown.power else ""
    if value != 0.0 and not any(digit in shown.words[0] for digit in "123456789"):  # rounds to 0: a log-scale interval
        return f"{number(value, 2)} [{number(low, 2)}, {number(high, 2)}]"
    return f"{shown.words[0]} [{shown.words[1]}, {shown.words[2]}]{times}"


def between(value: float, low: float, high: float) -> str:
    """An estimate with its 95 % interval, to two significant digits of a quarter of the interval's width."""
    return with_interval(value, low, high, (high - low) / 4.0)


class together:  # noqa: N801 - called like a function
    """Numbers written with a common power of ten and the same number of decimals.

    Attributes
    ----------
    words : the numbers without their power of ten.
    power : of ten; 0 if they are written without an exponent.
    """

    def __init__(self, *values: float, by: float) -> None:
        largest = max(*(abs(v) for v in values), by)
        power = _power(largest)
        self.power = 0 if SMALLEST <= power < LARGEST else power
        most = MOST_DIGITS - 1 - (power - self.power)
        decimals = min(1 - (_power(by) - self.power), most)  # negative: rounded to tens or hundreds
        shown = (round(value / 10.0**self.power, decimals) for value in values)
        self.words = tuple(_minus(f"{value:.{max(0, decimals)}f}") for value in shown)


def alike(*values: float, by: float) -> tuple[str, ...]:
    """Numbers of a row with a common power of ten, to two significant digits of a standard deviation."""
    if not (all(map(math.isfinite, values)) and math.isfinite(by) and by > 0.0):
        return tuple(number(value) for value in values)
    shown = together(*values, by=by)
    times = f"·10{_raised(shown.power)}" if shown.power else ""
    return tuple(f"{words}{times}" for words in shown.words)


def percent(share: float) -> str:
    """A share in percent, to two significant digits."""
    if not math.isfinite(share):
        return "–"
    hundred = 100.0 * share
    if hundred == 0.0:
        return "0 %"
    return _minus(f"{hundred:.{max(0, 1 - _power(hundred))}f} %")


def whole_percent(share: float) -> str:
    """A share in whole percent, without the percent sign."""
    if not math.isfinite(share):
        return number(share)
    rounded = round(100 * share)
    return f"−{-rounded}" if rounded < 0 else f"{rounded}"


def listed(words: Sequence[str]) -> str:
    """a, b and c."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"


def the_recordings(names: Sequence[str], which: str = "") -> str:
    """Recordings in prose: the recording “late”, the held-out recordings “late” and “later”."""
    return f"the {f'{which} ' * bool(which)}recording{'s' if len(names) > 1 else ''} {listed(quoted(names))}"


def quoted(names: Sequence[str]) -> list[str]:
    """Names in quotation marks, so that names such as late or other do not read as words of the sentence."""
    return [f"“{name}”" for name in names]


def signal_words(name: str) -> str:
    """A signal in prose: yaw rate for yaw_rate; a symbol such as a_x unchanged."""
    return name.replace("_", " ") if name in SIGNALS and len(name.split("_")[0]) > 1 else name


def capital(sentence: str) -> str:
    """The sentence with a capital at its start."""
    return sentence[:1].upper() + sentence[1:]


def counted(count: int, word: str, plural: str = "") -> str:
    """A count with its noun: 1 run, 4 runs."""
    return f"{count:,}".replace(",", " ") + " " + (word if count == 1 else plural or f"{word}s")


def _power(value: float) -> int:
    return math.floor(math.log10(abs(value))) if value else 0


def _raised(power: int) -> str:
    return str(power).translate(_RAISED)


def _minus(text: str) -> str:
    """A typographic minus sign instead of a hyphen, and no negative zero."""
    return re.sub(r"^-(?=[0.]*$)", "", text).replace("-", "−")
