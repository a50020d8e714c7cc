"""The simulation loop with steps of one millisecond; the driver decides at every row.

Fourth-order Runge-Kutta; a step in which a delayed command arrives is divided there. Row k's commands are applied at
its time and held; the readings of a row follow just after.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from greybox_id.base.machine_code import begun, compiled

from .actuators import CHAIN, driving_command, jump, move, road_wheel, settle, steering_command, wheel_force
from .chassis import SLIP_STIFFNESS, driven, motion, rolling_force, speed_for_slip
from .driver import DEVIATION, MIND, Driver, awaken, decide, re_anchor
from .layout import (  # fmt: skip
    ACROSS,
    ALONG,
    ANGLE,
    F_YF,
    F_YR,
    FORCE,
    FRICTION,
    GIVEN,
    GUST,
    LAGGED,
    LOAD,
    MASS,
    ROLL,
    ROLLING,
    SEEN,
    STATES,
    STEER,
    TIME,
    V_X,
    V_Y,
    WHEEL,
    YAW,
    YAW_RATE,
    Car,
    Grid,
    Row,
    X,
    Y,
    source,
)

STEP = 1e-3
"""Time step, s."""

_REACH, _SHARE = (0.0, 0.5, 0.5, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6)


@compiled
def read(s: Row, seen: Row, into: Row) -> None:
    """Write the quantities that sensors read, as in `READABLE`."""
    into[0], into[1], into[2] = s[V_X], s[V_Y], s[YAW_RATE]
    into[3], into[4], into[5], into[6], into[7] = seen[0], seen[1], seen[2], s[ROLL], seen[3]


@compiled
def note(car: Car, s: Row, given: Row, seen: Row, wheels: Grid, spin: Row, off: float, into: Row) -> None:
    """Write the truth of a row, as in `ROW_TRUTH`."""
    into[0], into[1], into[2], into[3], into[4] = s[X], s[Y], s[YAW], given[STEER], given[FORCE]
    into[5], into[6], into[7], into[8], into[9] = seen[F_YF], seen[F_YR], seen[FRICTION], off, given[MASS]
    for i in range(4):
        into[10 + i], into[14 + i] = wheels[i, LOAD], wheels[i, ALONG]
        into[18 + i], into[22 + i] = wheels[i, ANGLE], wheels[i, ACROSS]
        slip = wheels[i, ALONG] / max(SLIP_STIFFNESS * wheels[i, LOAD], 1e-9)
        rolls = wheels[i, ROLLING] * (1.0 + slip) / car.wheel_radius
        into[26 + i] = spin[i] if car.form_wheels == 1 else rolls / (1.0 - 0.1 * car.puncture * (i == 1))


@compiled
def turn_wheels(car: Car, s: Row, given: Row, wheels: Grid, spin: Row, faster: float, h: float) -> None:
    """Advance rotating wheels by h seconds, implicitly in the tyre's reaction.

    The force that accelerates the wheels with the vehicle, at its rate `faster`, is added, since commanded forces are
    defined as those that accelerate the vehicle. The rolling speed is that at the middle of the next step: with that at
    its beginning, slip and force would lag by half a step, which equals 1.8 % of a small car's mass.
    """
    F_xf, F_xr = driven(car, s, given)
    R, I_w = car.wheel_radius, car.I_w
    for i in range(4):
        requested = 0.5 * (F_xf if i < 2 else F_xr) + I_w / (R * R) * faster
        load = 0.5 * (wheels[2 * (i // 2), LOAD] + wheels[2 * (i // 2) + 1, LOAD])
        peak = load * (car.D_f if i < 2 else car.D_r) * car.grip_scale
        rolling = wheels[i, ROLLING] + 0.5 * h * faster
        back = R * R * SLIP_STIFFNESS * load / speed_for_slip(rolling)
        force = rolling_force(car, spin[i], rolling, load, peak)
        spin[i] = max(spin[i] + h * R * (requested - force) / (I_w + h * back), 0.0)


class Moment(NamedTuple):
    """State of the simulation between steps.

    Attributes
    ----------
    s, rate, change, trial : (STATES,) state and work arrays of a step.
    seen, given, wheels, spin : as in `chassis.motion`.
    chain, mind : of the actuators and of the driver.
    """

    s: Row
    rate: Row
    change: Row
    trial: Row
    seen: Row
    given: Row
    wheels: Grid
    spin: Row
    chain: Row
    mind: Row


def first_moment(car: Car, start: Row) -> Moment:
    """The state of a vehicle with v_x, v_y, yaw_rate in steady driving."""
    state, rest = np.zeros(STATES), (np.zeros(STATES), np.zeros(STATES), np.zeros(STATES))
    state[V_X], state[V_Y], state[YAW_RATE] = start
    spin = np.full(4, state[V_X] / float(car["wheel_radius"]))
    return Moment(
        state, *rest, np.zeros(SEEN), np.zeros(GIVEN), np.zeros((4, WHEEL)), spin, np.zeros(CHAIN), np.zeros(MIND)
    )


@cache
def simulator() -> Callable[..., None]:
    """The compiled simulation, `advance` below; compilation takes some seconds the first time after a change."""
    return _simulator(source())


def _simulator(stamp: str) -> Callable[..., None]:
    def advance(
        car: Car, knows: Driver, road: Grid, spacing: float, plan: Grid, first: int, hold: int, gusts: Row,
        now: Moment, begin: int, end: int, commands: Grid, readable: Any, truth: Grid,
    ) -> None:  # fmt: skip
        """Carry out steps of a plan.

        Parameters
        ----------
        car, knows : records of the vehicle and of its driver.
        road, spacing : (n, ROAD) points and the distance between them, m.
        plan : (rows, PLAN) for the driver; future rows are not read.
        first : row at which the origin of the world is set: x, y and yaw are zero there.
        hold : steps per row.
        gusts : (steps,) crosswind, m/s, or (1,) if there is none.
        now : state of the simulation, which is advanced.
        begin, end : first step, and the one after the last; steps after the last row hold its commands.
        commands : (rows, 2) steering and drive commands; written.
        readable : (steps, 2, k) `READABLE` at the beginning and at the end of every step; written.
        truth : (rows, k) `ROW_TRUTH` just after each row's time; written.
        """
        assert stamp
        rows = len(plan)
        s, rate, change, trial, seen, given, wheels, spin, chain, mind = now
        if begin == 0:
            awaken(mind, s[V_X])
        late = int(car.steering_delay / STEP + 1e-9)
        cut = max(car.steering_delay / STEP - late, 0.0)
        if cut < 1e-6:
            cut = 0.0

        for k in range(begin, end):
            row = min(k // hold, rows - 1)
            fresh = k % hold == 0 and k // hold < rows
            if k == first * hold:
                re_anchor(mind, s)
                s[X] = s[Y] = s[YAW] = 0.0
            if fresh:
                commands[row, 0], commands[row, 1] = decide(knows, road, spacing, plan, row, s, mind, hold * STEP)
            before = min(max((k - late - 1) // hold, 0), rows - 1)
            after = min(max((k - late) // hold, 0), rows - 1)
            arrives = cut > 0.0 and before != after
            requested = driving_command(car, commands[row, 1])
            given[GUST] = gusts[min(k, len(gusts) - 1)]
            given[TIME] = max(k - first * hold, 0) * STEP
            given[MASS] = max(1.0 - car.fuel_burn * given[TIME] / 60.0, 0.3)
            for piece in range(2 if arrives else 1):
                h = STEP if not arrives else (cut * STEP if piece == 0 else (1.0 - cut) * STEP)
                steer = steering_command(car, commands[before if arrives and piece == 0 else after, 0])
                if k == 0:
                    settle(car, chain, steer, requested)
                jump(car, chain, steer, requested)
                given[STEER], given[FORCE] = road_wheel(car, chain, s[V_X]), wheel_force(car, chain, s[V_X])
                settling = car.loads_shift > 0.0 and (fresh or before != after)
                for _ in range(20 if k == 0 else (4 if settling else 1)):  # until loads converge
                    motion(car, s, given, spin, seen, wheels, rate)
                    if k == 0:  # steady state: no lags
                        for i in range(LAGGED, LAGGED + 4):
                            trial[i] = rate[i]
                        s[ROLL] = car.roll_dynamics * seen[1]
                        settle_tyres(car, s, rate, wheels)
                if piece == 0:
                    read(s, seen, readable[k, 0])
                    if fresh:
                        note(car, s, given, seen, wheels, spin, mind[DEVIATION], truth[row])
                change[:] = 0.0
                for stage in range(4):
                    if stage > 0:
                        if stage != 2:
                            move(car, chain, steer, requested, 0.5 * h)
                        for i in range(STATES):
                            trial[i] = s[i] + _REACH[stage] * h * rate[i]
                        given[STEER], given[FORCE] = (
                            road_wheel(car, chain, trial[V_X]),
                            wheel_force(car, chain, trial[V_X]),
                        )
                        motion(car, trial, given, spin, seen, wheels, rate)
                    for i in range(STATES):
                        change[i] += _SHARE[stage] * h * rate[i]
                for i in range(STATES):
                    s[i] += change[i]
                if car.form_wheels == 1:
                    turn_wheels(car, s, given, wheels, spin, rate[V_X], h)
            read(s, seen, readable[k, 1])

    made: Callable[..., None] = begun(advance)
    return made


@compiled
def settle_tyres(car: Car, s: Row, rate: Row, wheels: Grid) -> None:
    """Set the tyres' relaxation states to their steady values."""
    if car.tyre_relaxation == 0.0:
        return
    for i in range(4):
        if car.form_relaxation == 1:  # a share of the peak; its rate is pace times the difference to steady state
            pace = min(abs(wheels[i, ROLLING]) / car.tyre_relaxation, 1500.0)
            s[LAGGED + i] += rate[LAGGED + i] / max(pace, 1e-6)
        else:
            s[LAGGED + i] = wheels[i, ANGLE]
