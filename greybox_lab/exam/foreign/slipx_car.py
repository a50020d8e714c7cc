"""SlipX, tier L2: a 1:10 car in C++ with thirteen states, load transfer, relaxation, battery and a servo.

Source: the SlipX authors, slipx 0.2 (Apache-2.0), from the package index. Effects for which it has no parameter are
applied between its steps: slope, bank and wind as accelerations, delays and play to the commands.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, exp, floor, hypot, inf, sin
from typing import Any

import numpy as np

from ...virtual.virtual_vehicle.layout import Grid, Row
from ...virtual.virtual_vehicle.loop import STEP
from ...virtual.virtual_vehicle.scale import G
from ..case import NotInstalled
from .vehicles import Stepwise

FASTEST_SERVO, SHORTEST = 1.5e-3, 0.8e-3
"""Time constant, s, and relaxation, s at the top speed, below which the steps of the simulator are too coarse."""
_DAMPING = 0.7


def arriving(commands: Grid, column: int, row: int, within: float, period: float, delay: float) -> float:
    """The command that arrives at a time after a row, linearly interpolated between rows."""
    place = (within - delay) / period
    behind = floor(place)
    at = row + behind
    if at < 0:
        return float(commands[0, column])
    here, after = commands[at, column], commands[min(at + 1, len(commands) - 1), column]
    return float(here + (after - here) * (place - behind))


def slipx_module() -> Any:
    """The package.

    Raises
    ------
    NotInstalled : if it is not installed.
    """
    try:
        import slipx
    except ImportError as error:
        raise NotInstalled(
            "Examinations of the family slipx need the package slipx; install it with pip install 'greybox-id[exam]'."
        ) from error
    return slipx


class SlipxCar(Stepwise):
    """The simulator with a vehicle; see `vehicles.Reality`.

    Parameters
    ----------
    numbers : as of `double_track.FIELDS`, and top_speed [m/s]; those of `families.NOT_OF_SLIPX` must be neutral.
    """

    def __init__(self, numbers: Mapping[str, float]) -> None:
        slipx = self._slipx = slipx_module()
        n = self._n = dict(numbers)
        L, weight = n["l_f"] + n["l_r"], n["m"] * G
        p = slipx.VehicleParams()
        p.mass, p.izz, p.lf, p.lr = n["m"], n["I_z"], n["l_f"], n["l_r"]
        p.track_front, p.track_rear, p.wheel_radius = n["track_f"], n["track_r"], n["wheel_radius"]
        p.h_cog = max(n["h_cg"] * n.get("height", 0.0), 1e-6)
        p.c_alpha_f, p.c_alpha_r = n["slope_f"] * weight * n["l_r"] / L, n["slope_r"] * weight * n["l_f"] / L
        strength = max(n.get("ellipse", 0.0) + n.get("combined", 0.0), 1e-2)
        for axle, name in (("f", "tyre_front"), ("r", "tyre_rear")):
            tyre = getattr(p, name)
            tyre.mu_y0, tyre.mu_x0 = n[f"mu_{axle}"], n[f"mu_{axle}"] / strength
            tyre.k_mu = n.get("load_exponent", 0.0)
            tyre.shape_c, tyre.curvature_e = n["shape_c"], n["curvature_e"]
            tyre.relax_length = max(n.get("relaxation", 0.0), SHORTEST * n["top_speed"])
            setattr(p, name, tyre)
        p.roll_resist, p.drag_coeff = n["c_0"] / weight, n["c_2"]
        p.steer_max, p.steer_rate_max = 1.0, min(n.get("steer_rate", inf), 1e4)
        p.steer_damping = _DAMPING
        p.steer_bandwidth = 2.0 * _DAMPING / max(n.get("steer_time", 0.0) + n.get("steer_lag", 0.0), FASTEST_SERVO)
        p.accel_max = p.decel_max = 1e3
        p.v_max = 1e3
        p.layout = slipx.DriveLayout.AllWheelDrive if n["drive_split_front"] > 0 else slipx.DriveLayout.RearWheelDrive
        p.differential = slipx.Differential.Spool if n.get("locked_axle", 0.0) > 0.0 else slipx.Differential.Open
        p.torque_per_amp, p.current_max = 1.0, 1e6
        p.regen_current_max, p.torque_stall, p.omega_free, p.pack_internal_resistance = 1e6, 1e6, 1e6, 0.0
        p.pack_v_full = p.pack_v_empty = p.pack_nominal_v
        p.pack_capacity_ah = 1e9
        if n.get("drive_most", inf) < inf:  # limited by the current, and from the corner speed on by the voltage
            p.current_max = n["drive_most"] * n["m"] * n["wheel_radius"]
            p.omega_free = 2.2 * n["drive_corner"] / n["wheel_radius"]
            p.torque_stall = p.current_max / (1.0 - 1.0 / 2.2)
        self._model = slipx.VehicleModel.create(slipx.Tier.L2_DoubleTrack, p)
        self._seen, self._input = slipx.StepDiagnostics(), slipx.DriveInput()
        self._per_unit = n["force_per_unit"] * n.get("drive_gain", 1.0) / n["m"]
        self._lag = n.get("drive_time", 0.0) + n.get("drive_lag", 0.0)
        self.state: Row = np.zeros(6)

    def begin(self, start: tuple[float, ...], steer: float, drive: float) -> None:
        """Start in motion, with constant commands before."""
        n, (v_x, v_y, yaw_rate) = self._n, start
        s = self._state = self._slipx.VehicleState()
        s.vel_body.x, s.vel_body.y, s.rates.z = v_x, v_y, yaw_rate
        self._play = steer
        s.steer = steer * n.get("steer_ratio", 1.0) + n.get("steer_offset", 0.0)
        s.omega_w = [v_x / n["wheel_radius"]] * 4
        front = (v_y + n["l_f"] * yaw_rate) / max(v_x, 0.5) - s.steer
        rear = (v_y - n["l_r"] * yaw_rate) / max(v_x, 0.5)
        s.alpha_lag = [front, front, rear, rear]
        self._driven = drive * self._per_unit
        self._time, self._roll, self._before = 0.0, (0.0, 0.0), (0.0, 0.0)
        self.state = np.array([v_x, v_y, yaw_rate, 0.0, 0.0, 0.0])

    def advance(self, commands: Grid, row: int, steps: int, period: float, out: Any) -> None:
        """Simulate one row with its commands."""
        n, s, seen, requested = self._n, self._state, self._seen, self._input
        delay = n.get("steer_delay", 0.0)
        play, lag, step = n.get("steer_backlash", 0.0), self._lag, self._model.step
        ratio, offset = n.get("steer_ratio", 1.0), n.get("steer_offset", 0.0)
        along, across = G * sin(n.get("slope", 0.0)), G * sin(n.get("bank", 0.0))
        keep = exp(-STEP / lag) if lag > 0.0 else 0.0
        gradient, w = n.get("roll_gradient", 0.0), 2.0 * np.pi * n.get("roll_frequency", 1.5)
        damping = n.get("roll_damping", 0.3)
        wind, towards, c_2, m = n.get("wind", 0.0), n.get("wind_direction", 0.0), n["c_2"], n["m"]
        for k in range(steps):
            within = (k + 0.5) * STEP
            target = arriving(commands, 0, row, within, period, delay)
            self._play = min(max(self._play, target - play), target + play)
            force = arriving(commands, 1, row, within, period, 0.0) * self._per_unit
            force *= 1.0 - n.get("sinking_voltage", 0.0) * self._time / 60.0
            self._driven = force + (self._driven - force) * keep
            requested.steer_cmd, requested.accel_cmd = self._play * ratio + offset, self._driven
            v = s.vel_body
            v_x, v_y, r = v.x, v.y, s.yaw_rate
            step(s, requested, STEP, seen)
            v = s.vel_body
            a_x, a_y, yaw_acceleration = seen.ax, seen.ay, (s.yaw_rate - r) / STEP
            if along or across or wind:
                push_x, push_y = -along * STEP, -across * STEP
                if wind:  # the simulator has drag in still air only
                    yaw = s.yaw
                    air_x, air_y = v.x - wind * cos(towards - yaw), v.y - wind * sin(towards - yaw)
                    more_x = (c_2 * abs(v.x) * v.x - c_2 * hypot(air_x, air_y) * air_x) / m
                    more_y = -c_2 * hypot(air_x, air_y) * air_y / m
                    push_x, push_y = push_x + more_x * STEP, push_y + more_y * STEP
                    a_x, a_y = a_x + more_x, a_y + more_y
                v.x, v.y = v.x + push_x, v.y + push_y
            roll, rate = self._roll
            roll_acceleration = w * w * (gradient * a_y - roll) - 2.0 * damping * w * rate
            rate += roll_acceleration * STEP
            self._roll = roll + rate * STEP, rate
            out[k, 0] = (v_x, v_y, r, a_x, a_y, yaw_acceleration, roll, roll_acceleration)
            out[k, 1] = (v.x, v.y, s.yaw_rate, a_x, a_y, yaw_acceleration, self._roll[0], roll_acceleration)
            self._time += STEP
        self.state = np.array([s.vel_body.x, s.vel_body.y, s.yaw_rate, s.pos.x, s.pos.y, s.yaw])
