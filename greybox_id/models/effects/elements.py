"""Dynamic elements between a command and the vehicle: lag, rate limit and play.

Over a segment of h seconds the command is a straight line. What the vehicle sees is again a straight line: the one of
the same mean and first moment as the element's true response, so that nothing is lost to the length of a segment.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as cs

from ...model import Namespace, Symbol
from ...motion_model import Actuator
from ...transient import mean_and_slope
from ..smooth import within_limit

Line = tuple[Symbol, Symbol]
"""Value at the beginning and at the end of a segment."""
Motion = Callable[[Symbol, Symbol, Namespace, float], Symbol]
"""(state, command, p, time) -> what an element does in that time."""

TINY_TIME = 1e-15
"""Added to time constants, s: the limit of no lag without a division by zero."""
SHORTEST = 1e-12
"""Added to segments' lengths, s; segments that only fill up have none."""
TINY = 1e-13
"""Added where zero would be divided by zero."""
PLAY_WIDTH = 1e-5
"""Width over which play takes up, in the signal's unit."""


def lag(signal: str, name: str, time_constant: Callable[[Namespace], Symbol]) -> Actuator:
    """First-order lag, exact for commands that are straight lines over a segment."""

    def segment(state: Symbol, command: Line, p: Namespace, h: Symbol) -> tuple[Symbol, Line]:
        T, h = time_constant(p) + TINY_TIME, h + SHORTEST
        begin, end = command
        behind = (end - begin) * T / h  # how far a steady ramp is followed behind
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


def rate_limit(signal: str, name: str, limit: Callable[[Namespace], Symbol]) -> Actuator:
    """Rate limit: a ramp until the command is reached, then the command; no limit at infinity.

    The gap between command and output closes straight from where it is; once closed, it opens again if the command is
    too fast. Corners are rounded as `within_limit` says.
    """

    def segment(state: Symbol, command: Line, p: Namespace, h: Symbol) -> tuple[Symbol, Line]:
        off, moved = command[0] - state, command[1] - command[0]
        towards = _sign(off + 1e-6 * moved)
        gap, pace = ((x / limit(p) / (h + SHORTEST)) for x in (off * towards, moved * towards))  # in what h allows
        closed = (gap + TINY) / cs.fmax(1 - pace, gap + TINY)  # when the gap is closed, in segments; 1 if not at all
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
        del time  # it follows at once
        w, ahead = half_width(p), command - state
        return _beyond(ahead - w) - _beyond(-ahead - w)

    def segment(state: Symbol, command: Line, p: Namespace, h: Symbol) -> tuple[Symbol, Line]:
        del h
        begin = state + moves(state, command[0], p)
        end = begin + moves(begin, command[1], p)
        wanted, done = command[1] - command[0], end - begin
        # It moves with the command for the segment's last share, 0 to 1; where corners are rounded, any number.
        moving = cs.fmin(cs.fmax(done * wanted / (wanted**2 + TINY**2), -1), 2)
        return end, (begin - done * moving * (1 - moving), begin + done * moving * (2 - moving))

    return Actuator(signal, name, segment, _from_where_it_stands(moves), moves)


def _from_where_it_stands(moves: Motion) -> Motion:
    return lambda state, command, p, time: state + moves(state, command, p, time)


def _sign(x: Symbol) -> Symbol:
    """Plus or minus one, with a derivative at zero."""
    return x / cs.sqrt(x**2 + TINY**2)


def _beyond(x: Symbol) -> Symbol:
    """What of x is above zero, a parabola within `PLAY_WIDTH`; exactly zero below: what rests must not creep."""
    near = cs.fmax(cs.fmin(x, PLAY_WIDTH), -PLAY_WIDTH)
    return (near + PLAY_WIDTH) ** 2 / (4 * PLAY_WIDTH) + cs.fmax(x - PLAY_WIDTH, 0)
