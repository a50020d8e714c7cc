"""Dynamic elements between a command and the vehicle: lag, second-order servo, rate limit and play.

Over a segment of h seconds the command is a straight line. The vehicle's input is a straight line too: the one with
the same mean and first moment as the element's exact response, so that results do not depend on the segment length.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi

import casadi as cs

from ..model import Namespace, Symbol
from ..motion_model import Actuator
from ..smooth import mean_and_slope, within_limit

Line = tuple[Symbol, Symbol]
"""Value at the beginning and at the end of a segment."""
Motion = Callable[[Symbol, Symbol, Namespace, float], Symbol]
"""(state, command, p, time) -> change of the element's output in that time."""

TINY_TIME = 1e-15
"""Added to time constants, s: avoids division by zero for a vanishing lag."""
SHORTEST = 1e-12
"""Added to lengths of segments, s; padding segments have length zero."""
TINY = 1e-13
"""Added to avoid 0 / 0."""
FASTEST = 1e15
"""Largest natural frequency of a servo, Hz: for an infinite one, the product with a segment's length stays finite."""
FADED = 1e3
"""Time, in units of 1 / w, after which an oscillation has decayed; its sine is not evaluated beyond."""
SHORT_SWING, SWING_TERMS = 0.03, 6
"""Time, in units of 1 / w, below which oscillations are computed from this many terms of their series, to avoid
cancellation."""
PLAY_WIDTH = 1e-5
"""Width over which the corners of play are rounded, in the signal's unit."""


def lag(signal: str, name: str, time_constant: Callable[[Namespace], Symbol]) -> Actuator:
    """First-order lag, exact for commands that are straight lines over a segment."""

    def segment(state: Symbol, command: Line, p: Namespace, h: Symbol) -> tuple[Symbol, Line]:
        T, h = time_constant(p) + TINY_TIME, h + SHORTEST
        begin, end = command
        behind = (end - begin) * T / h  # steady lag behind a ramp
        off = state - begin + behind
        a = h / T
        mean, slope = mean_and_slope(a)
        line = (begin - behind + off * (mean - slope / 2), end - behind + off * (mean + slope / 2))
        return end - behind + off * cs.exp(-a), line

    def after(state: Symbol, command: Symbol, p: Namespace, time: float) -> Symbol:
        return command + (state - command) * cs.exp(-time / (time_constant(p) + TINY_TIME))

    def moves(state: Symbol, command: Symbol, p: Namespace, time: float) -> Symbol:
        return (state - command) * cs.expm1(-time / (time_constant(p) + TINY_TIME))

    return Actuator(signal, name, segment, after, moves)


def servo(
    signal: str, name: str, frequency: Callable[[Namespace], Symbol], damping: Callable[[Namespace], Symbol]
) -> tuple[Actuator, Actuator]:
    """Second-order servo, x'' = w^2 (u - x) - 2 d w x' with d < 1, exact for commands that are straight lines.

    Its states are the output x and the output extrapolated by 1 / w at its rate, a = x + x' / w: both equal the command
    at rest. Relative to the steady response to a ramp of slope s, u - 2 d s / w, the deviation y = (x, x' / w) obeys
    y' = A y in the scaled time w t, A = [[0, 1], [-1, -2 d]].

    Parameters
    ----------
    signal, name : the input it acts on; prefix of its states' names.
    frequency : p -> natural frequency, Hz; infinite for a servo without lag.
    damping : p -> damping ratio, below one.
    """

    def w(p: Namespace) -> Symbol:
        return 2 * pi * cs.fmin(frequency(p), FASTEST)

    def off(where: Symbol, ahead: Symbol, command: Line, p: Namespace, r: Symbol) -> tuple[Line, Symbol]:
        behind = (command[1] - command[0]) / r
        return (where - command[0] + 2 * damping(p) * behind, ahead - where - behind), behind

    def ends(where: Symbol, ahead: Symbol, command: Line, p: Namespace, h: Symbol) -> Line:
        r, d = w(p) * (h + SHORTEST), damping(p)
        y, behind = off(where, ahead, command, p, r)
        y_1, y_2 = _swung(y, r, d)
        x = command[1] - 2 * d * behind + y_1
        return x, x + y_2 + behind

    def angle(state: Line, command: Line, p: Namespace, h: Symbol) -> tuple[Symbol, Line]:
        where, ahead = state
        r, d = w(p) * (h + SHORTEST), damping(p)
        y, behind = off(where, ahead, command, p, r)
        mean, slope = _swing_line(y, r, d)
        x, _ = ends(where, ahead, command, p, h)
        late = 2 * d * behind
        return x, (command[0] - late + mean - slope / 2, command[1] - late + mean + slope / 2)

    def lead(state: Line, command: Line, p: Namespace, h: Symbol) -> tuple[Symbol, Line]:
        ahead, where = state
        return ends(where, ahead, command, p, h)[1], command

    def moved(where: Symbol, ahead: Symbol, command: Symbol, p: Namespace, time: float) -> Line:
        return _swings((where - command, ahead - where), w(p) * time, damping(p))

    def angle_moves(state: Line, command: Symbol, p: Namespace, time: float) -> Symbol:
        return moved(*state, command, p, time)[0]

    def lead_moves(state: Line, command: Symbol, p: Namespace, time: float) -> Symbol:
        y_1, y_2 = moved(state[1], state[0], command, p, time)
        return y_1 + y_2

    def angle_after(state: Line, command: Symbol, p: Namespace, time: float) -> Symbol:
        """First-order expansion of the oscillation, also right once it has decayed; costs a third of `moved`."""
        r, d = w(p) * time, damping(p)
        return command + cs.exp(-d * r) * ((state[0] - command) * (1 + d * r) + (state[1] - state[0]) * r)

    first, then = f"{name}_lead", f"{name}_angle"
    return (
        Actuator(signal, first, lead, lambda state, command, p, time: command, lead_moves, beside=then),
        Actuator(signal, then, angle, angle_after, angle_moves, beside=first),
    )


def _swung(y: Line, r: Symbol, d: Symbol) -> Line:
    """exp(A r) y."""
    fast = cs.sqrt(1 - d**2)
    turned = fast * cs.fmin(r, FADED)
    fading, c, s = cs.exp(-d * r), cs.cos(turned), cs.sin(turned) / fast
    y_1, y_2 = y
    return fading * (c * y_1 + s * (d * y_1 + y_2)), fading * (c * y_2 - s * (y_1 + d * y_2))


def _swings(y: Line, r: Symbol, d: Symbol) -> Line:
    """(exp(A r) - 1) y without cancellation."""
    terms, (y_1, y_2) = _swing_terms(y, r, d)[1:], _swung(y, r, d)
    short = r < SHORT_SWING
    return (cs.if_else(short, sum(term[0] for term in terms), y_1 - y[0]),
            cs.if_else(short, sum(term[1] for term in terms), y_2 - y[1]))  # fmt: skip


def _swing_line(y: Line, r: Symbol, d: Symbol) -> Line:
    """Mean and slope of the line equivalent to the first component of exp(A r s) y, s from 0 to 1."""
    (one, two), (y_1, y_2) = y, _swung(y, r, d)
    mean, other = (-2 * d * (y_1 - one) - (y_2 - two)) / r, (y_1 - one) / r
    moment = (-2 * d * (y_1 - mean) - (y_2 - other)) / r
    terms, short = [swing_term[0] for swing_term in _swing_terms(y, r, d)], r < SHORT_SWING
    mean = cs.if_else(short, sum(term / (n + 1) for n, term in enumerate(terms)), mean)
    moment = cs.if_else(short, sum(term / (n + 2) for n, term in enumerate(terms)), moment)
    return mean, 12 * (moment - mean / 2)


def _swing_terms(y: Line, r: Symbol, d: Symbol) -> list[Line]:
    """Terms (A r)^n y / n! of the series, n from 0 to SWING_TERMS - 1."""
    result = [y]
    for n in range(1, SWING_TERMS):
        one, two = result[-1]
        result.append((two * r / n, (-one - 2 * d * two) * r / n))
    return result


def rate_limit(signal: str, name: str, limit: Callable[[Namespace], Symbol]) -> Actuator:
    """Rate limit: a ramp until the command is reached, then the command itself; an infinite limit has no effect.

    The gap between command and output closes at the limiting rate; once closed, it opens again if the command is too
    fast. Corners are rounded by `within_limit`.
    """

    def segment(state: Symbol, command: Line, p: Namespace, h: Symbol) -> tuple[Symbol, Line]:
        off, moved = command[0] - state, command[1] - command[0]
        towards = _sign(off + 1e-6 * moved)
        gap, pace = ((x / limit(p) / (h + SHORTEST)) for x in (off * towards, moved * towards))  # over the limit
        closed = (gap + TINY) / cs.fmax(1 - pace, gap + TINY)  # time of closing over h; 1 if it stays open
        unclosed = (off + moved) * (1 - within_limit(gap + pace))
        opened = moved * (1 - closed) * (1 - within_limit(cs.fabs(pace)))
        closing = off - unclosed
        begin = command[0] - unclosed - closing * closed * (2 - closed) + opened * closed * (1 - closed)
        end = command[1] - unclosed + closing * closed * (1 - closed) - opened * (1 - closed) * (1 + closed)
        return command[1] - unclosed - opened, (begin, end)

    def moves(state: Symbol, command: Symbol, p: Namespace, time: float) -> Symbol:
        gap = command - state
        return gap * within_limit(gap * _sign(gap) / limit(p) / time)

    return Actuator(signal, name, segment, _from_where_it_stands(moves), moves)


def play(signal: str, name: str, half_width: Callable[[Namespace], Symbol]) -> Actuator:
    """Play (backlash): the output rests until the command has crossed the gap. Rounded over `PLAY_WIDTH`."""

    def moves(state: Symbol, command: Symbol, p: Namespace, time: float = 0.0) -> Symbol:
        del time  # play acts without delay
        w, ahead = half_width(p), command - state
        return _beyond(ahead - w) - _beyond(-ahead - w)

    def segment(state: Symbol, command: Line, p: Namespace, h: Symbol) -> tuple[Symbol, Line]:
        del h
        begin = state + moves(state, command[0], p)
        end = begin + moves(begin, command[1], p)
        target, done = command[1] - command[0], end - begin
        # Share, 0 to 1, of the segment at its end in which the output moves; arbitrary where corners are rounded.
        moving = cs.fmin(cs.fmax(done * target / (target**2 + TINY**2), -1), 2)
        return end, (begin - done * moving * (1 - moving), begin + done * moving * (2 - moving))

    return Actuator(signal, name, segment, _from_where_it_stands(moves), moves)


def _from_where_it_stands(moves: Motion) -> Motion:
    return lambda state, command, p, time: state + moves(state, command, p, time)


def _sign(x: Symbol) -> Symbol:
    """Sign, +1 or -1, smoothed so that it is differentiable at zero."""
    return x / cs.sqrt(x**2 + TINY**2)


def _beyond(x: Symbol) -> Symbol:
    """Positive part of x, a parabola within `PLAY_WIDTH`; exactly zero below, so that no resting output creeps."""
    near = cs.fmax(cs.fmin(x, PLAY_WIDTH), -PLAY_WIDTH)
    return (near + PLAY_WIDTH) ** 2 / (4 * PLAY_WIDTH) + cs.fmax(x - PLAY_WIDTH, 0)
