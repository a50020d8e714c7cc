"""Timing faults with a size: channels that are early or late, and clocks that run at another rate."""

from __future__ import annotations

import numpy as np

from ...base.numbers import number, percent
from ...base.shorthands import Array
from ..recording import Recording
from .delays import estimate_lag
from .finding import Explanation
from .pairs import rate, smooth
from .relations import SMOOTHING, thinned

GOES_WITH = 0.9
"""Correlation from which a channel follows its reference: four fifths of its variance are explained."""
RUNS_FAST, FASTEST, LONGEST = 0.004, 0.04, 2.0
"""Smallest and largest relative clock error to search, and the largest delay searched with it, s."""
MOST_TRIES, NEAR_TRIES = 100, 4
"""Rates tried in each direction at first, and then around the estimate from fewer rows."""
RESPONSE, PER_ROOT = 0.12, 0.12
"""Largest delay of yaw_rate after steer in s: a constant plus a term per square root of the wheelbase in m, since tyres
take longer to turn a larger inertia."""
SIDEWAYS_RESPONSE = 0.5
"""Share of that delay by which a_y may precede or follow v_x · yaw_rate: v_y responds within it."""


def clocks(r: Recording) -> list[Explanation]:
    """Channels that are early or late, and clocks that run fast or slow."""
    result: list[Explanation] = []
    longest = max(r.runs, key=lambda run: run[1] - run[0])
    rows, dt = slice(*longest), r.sample_time
    count = longest[1] - longest[0]
    if count * dt < 12.0:
        return []
    result += _shifted(r, rows)
    r = thinned(r)
    rows = slice(*max(r.runs, key=lambda run: run[1] - run[0]))
    if r.has("a_y", "yaw_rate"):
        result += _runs_fast(r, rows, "a_y", r["a_y"], r["v_x"] * r["yaw_rate"])
    if r.has("a_x"):
        result += _runs_fast(r, rows, "a_x", r["a_x"], rate(r, r["v_x"]))
    return result


def _shifted(r: Recording, rows: slice) -> list[Explanation]:
    """Channels that are early or late: yaw_rate follows steer by the vehicle's response, a_y coincides with v_x ·
    yaw_rate.

    Of two channels with a time offset, the one that is also offset from a third is named.
    """
    if not r.has("steer", "yaw_rate"):
        return []
    dt, turn = r.sample_time, r["yaw_rate"][rows]

    def late(left: Array, right: Array) -> tuple[float, float, float] | None:
        lag = estimate_lag(left, right, dt, 0.05, 1.0)
        sure = lag is not None and lag.error * dt < 0.05 and lag.gain > 0
        return (lag.samples * dt, lag.error * dt, lag.gain) if lag is not None and sure else None

    after = late(turn, (r["v_x"] * r["steer"])[rows])
    if after is None:
        return []
    seconds, error, gain = after
    most = float(RESPONSE + PER_ROOT * np.sqrt(np.clip(1.0 / gain, 0.05, 15.0)))
    apart = seconds > most or seconds < -0.03
    aside = late(r["a_y"][rows], r["v_x"][rows] * turn) if r.has("a_y") else None
    beside = aside is not None and abs(aside[0]) > SIDEWAYS_RESPONSE * most
    if apart and beside and aside is not None and (seconds > 0) == (aside[0] < 0):
        name, (seconds, error, _) = "yaw_rate", aside
        seconds = -seconds
        order = "before" if seconds > 0 else "after"
        sentence = f"a_y comes {number(1000 * abs(seconds), 3)} ms {order} v_x · yaw_rate, but should coincide with it"
    elif apart:
        name, seconds = "steer", -seconds
        sentence = (
            f"yaw_rate lags v_x · steer by {number(-1000 * seconds, 3)} ms, but a vehicle responds within "
            f"{number(1000 * most, 2)} ms"
        )
    elif beside and aside is not None:
        name, (seconds, error, _) = "a_y", aside
        sentence = (
            f"it comes {number(1000 * abs(seconds), 3)} ms {'after' if seconds > 0 else 'before'} v_x · yaw_rate, but "
            "should coincide with it"
        )
    else:
        return []
    word = "late" if seconds > 0 else "early"
    fitted = " or fit with steering_delay" if name == "steer" else " or fit with a sensor's latency"
    return [
        Explanation(
            f"{name} is {word}: {sentence}. Shift {name} in time,{fitted}.",
            name, abs(seconds), error, "s", (seconds / max(error, 1e-3)) ** 2, witnessed=name != "a_y",
        )
    ]  # fmt: skip


def _runs_fast(r: Recording, rows: slice, name: str, left: Array, right: Array) -> list[Explanation]:
    """A channel whose clock runs at another rate: only after stretching does it follow its reference."""
    dt, count = r.sample_time, rows.stop - rows.start
    u, v = (np.nan_to_num(smooth(r, item, SMOOTHING)[rows]) for item in (left, right))

    def step_of(rows: int) -> float:
        """Step of the relative rate for a number of rows: it shifts the ends by a quarter of the smoothing."""
        return SMOOTHING / max(rows * dt, 1e-9) / 4.0

    first = min(count, int(SMOOTHING * MOST_TRIES / (4.0 * FASTEST * dt)))
    stretch, length, reach = 0.0, first, int(FASTEST / step_of(first))
    while True:  # twice as many rows resolve the rate twice as finely, so only rates near the estimate are tried
        tries = stretch + step_of(length) * np.arange(-reach, reach + 1)
        result = [_follows(u[:length], v[:length], float(item), dt) for item in tries]
        k = int(np.argmax(result))
        stretch = float(tries[k])
        if length == count or result[k] < GOES_WITH:
            break
        length, reach = min(2 * length, count), NEAR_TRIES
    plain, step = _follows(u[:length], v[:length], 0.0, dt), step_of(length)
    if (
        abs(stretch) < RUNS_FAST
        or result[k] < GOES_WITH
        or 1.0 - plain < 2.0 * (1.0 - result[k])
        or result[k] - plain < 0.05
    ):
        return []
    word, apart = "fast" if stretch > 0 else "slow", abs(stretch) * count * dt
    independent = count * dt / (2.0 * SMOOTHING)
    return [
        Explanation(
            f"The clock of {name} runs {percent(abs(stretch))} {word}: within the drive it gains "
            f"{number(apart, 2)} s. Join {name} by its own time stamps (greybox data join).",
            name, stretch, step, "1", independent * (1.0 - plain) / max(1.0 - result[k], 1e-3),
        )
    ]  # fmt: skip


def _follows(u: Array, v: Array, stretch: float, dt: float) -> float:
    """Largest correlation of a stretched series with another over delays of up to `LONGEST`."""
    count = len(u)
    grid, size, reach = np.arange(count, dtype=float), 1 << (2 * count).bit_length(), min(int(LONGEST / dt), count // 4)
    moved, other = np.interp(grid * (1.0 + stretch), grid, u), v - v.mean()
    moved = moved - moved.mean()
    products = np.fft.irfft(np.fft.rfft(moved, size) * np.conj(np.fft.rfft(other, size)), size)
    scale = float(np.sqrt(np.sum(moved**2) * np.sum(other**2)))
    return float(np.max(np.concatenate([products[-reach:], products[: reach + 1]]))) / max(scale, 1e-300)
