"""A case with a foreign vehicle: drawn, identified as a single track, with withheld effects, driven twice.

Also drives of a foreign vehicle, and readings of sensors from its motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording

from ...virtual.virtual_vehicle import EFFECTS as VOCABULARY
from ...virtual.virtual_vehicle import Tolerances, VirtualCar, toleranced, tolerances
from ...virtual.virtual_vehicle.driver import driver
from ...virtual.virtual_vehicle.effects import OF_THE_SENSORS, complete
from ...virtual.virtual_vehicle.layout import OPEN_DRIVE, READABLE, ROAD, TURN, Grid, Row
from ...virtual.virtual_vehicle.loop import STEP
from ...virtual.virtual_vehicle.manoeuvres import closed_road, planned, robot
from ...virtual.virtual_vehicle.sensors import Motion, hung, instants, noisy, read
from ..case import Draw, MadeCase, fair_case, with_lateral_velocity
from ..folder import columns_text
from ..plan import Planned
from ..replays import Replays
from .double_track import DoubleTrack
from .families import ENTRIES, FAMILIES, OUTSIDE, gusts, magnitude, roughened, together, withheld
from .vehicles import Reality, Task, chassis, single_track

RUN_IN = 3.0
"""Duration of straight driving before the first row, s."""
MOST = 1e3
"""Largest velocity or yaw rate that counts as a motion of a vehicle."""


@dataclass(frozen=True)
class Ride:
    """A vehicle's motion with its commands.

    Attributes
    ----------
    commands : (rows, 2) steering, rad, and drive, in the unit of its channel.
    motion : as read by sensors, from the first row on.
    period : between rows, s.
    linear_hold : whether commands are linear between rows; otherwise they are held.
    """

    commands: Grid
    motion: Motion
    period: float
    linear_hold: bool

    def arriving(self, column: int, share: float) -> Row:
        """A command at a share of a period after each row, (rows,); simulators use that in the middle of a step."""
        now = self.commands[:, column]
        after = np.append(now[1:], now[-1])
        share = share + 0.5 * STEP / self.period
        return np.asarray(now + share * (after - now) if self.linear_hold else now)

    @property
    def start(self) -> dict[str, float]:
        """v_x, v_y, yaw_rate at the first row."""
        first = self.motion.readable[self.motion.first, 0]
        return dict(zip(("v_x", "v_y", "yaw_rate"), map(float, first[:3]), strict=True))

    def truth(self, after: float = 0.0) -> dict[str, Row]:
        """The motion at a time in s after each row's commands, by name of `layout.READABLE`."""
        hold, first = round(self.period / STEP), self.motion.first + round(after / STEP)
        now = self.motion.readable[first : first + len(self.commands) * hold : hold, 0]
        return {name: now[:, k] for k, name in enumerate(READABLE)}


def driven(reality: Reality, car: VirtualCar, seconds: float, rate: float, seed: int, manoeuvre: str = "mixed") -> Ride:
    """Simulate a foreign vehicle with a driver, who knows it as a single track.

    Raises
    ------
    BadInput : if the simulation diverged.
    """
    plans, roads = np.random.default_rng((seed, 1, 4099)), np.random.default_rng((seed, 0, 4099))
    size, rows, run_in = car.size, max(int(round(seconds * rate)), 2), ceil(RUN_IN * rate)
    road, spacing = closed_road(size, float(plans.uniform(0.6, 0.88)), roads)
    plan = planned(manoeuvre, size, rows, run_in, rate, float(road[0, 4]), plans)
    return _carried_out(reality, car, plan, road, spacing, run_in, (float(plan[0, 2]), 0.0, 0.0), 1.0 / rate)


def replayed(reality: Reality, car: VirtualCar, commands: Grid, period: float, start: Mapping[str, float]) -> Ride:
    """Simulate the same commands again, without a driver; those of the first row are assumed constant before."""
    begin = tuple(start[name] for name in ("v_x", "v_y", "yaw_rate"))
    plan = robot(commands[:, 0], commands[:, 1])
    return _carried_out(reality, car, plan, np.zeros((8, ROAD)), 1.0, 0, begin, period)


def _carried_out(
    reality: Reality, car: VirtualCar, plan: Grid, road: Grid, spacing: float, run_in: int,
    start: tuple[float, ...], period: float,
) -> Ride:  # fmt: skip
    hold, rows = round(period / STEP), len(plan)
    task = Task(driver(car), road, spacing, plan, hold, period)
    commands = np.array(plan[:, [TURN, OPEN_DRIVE]]) if task.by_robot else np.zeros((rows, 2))
    readable: NDArray[np.float64] = np.zeros(((rows + 1) * hold, 2, len(READABLE)))
    reality.carry_out(task, start, commands, readable[: rows * hold])
    if not np.all(np.abs(readable[:, :, :3]) < MOST):
        raise BadInput("The simulation diverged; the vehicle or its effects are implausibly large.")
    readable[rows * hold :] = readable[rows * hold - 1, 1]
    return Ride(commands[run_in:], Motion(readable, run_in * hold), period, reality.linear_hold)


def readings(ride: Ride, car: VirtualCar, effects: Mapping[str, float], seed: int) -> dict[str, Row]:
    """Noise-free readings of sensors, name -> (rows,)."""
    return hung(_clean(ride, car, effects, seed), _time(ride), _all(car, effects), _rng(seed, 6))


def recorded(ride: Ride, car: VirtualCar, effects: Mapping[str, float], seed: int, name: str) -> Recording:
    """A recording with the stated noise; repeated readings have the same noise."""
    seen = noisy(_clean(ride, car, effects, seed), car.noise, ride.period, 0.0, 0.0, 0.0, _rng(seed, 5))
    signals = hung(seen, _time(ride), _all(car, effects), _rng(seed, 6))
    signals |= {"steer": ride.commands[:, 0], car.drive_channel: ride.commands[:, 1]}
    return Recording(name, _time(ride), signals)


def _clean(ride: Ride, car: VirtualCar, effects: Mapping[str, float], seed: int) -> dict[str, Row]:
    """Noise-free readings without repeated ones."""
    everything, known = _all(car, effects), {**car.parameters, "top_speed": car.size.top_speed}
    when = instants(_time(ride), everything, False, _rng(seed, 3))
    return read(ride.motion, when, everything, known, _rng(seed, 4))


def _all(car: VirtualCar, effects: Mapping[str, float]) -> dict[str, float]:
    """Magnitudes of all effects of sensors."""
    return complete({name: effect for name, effect in effects.items() if name in OF_THE_SENSORS}, car.size)


def _time(ride: Ride) -> Row:
    return np.linspace(0.0, ride.period * (len(ride.commands) - 1), len(ride.commands), dtype=np.float64)


def _rng(seed: int, stream: int) -> np.random.Generator:
    """Random generators by purpose, so that draws for one do not change the others."""
    return np.random.default_rng((seed, stream, 4099))


_TYRES = tuple(f"{name}_{axle}" for axle in "fr" for name in "BCDE")
_LEAST = np.array([0.5, 0.6, 0.2, -4.0] * 2 + [0.5] + [0.0, 0.0, 0.0, 0.3])
_MOST = np.array([80.0, 2.6, 3.0, 0.98] * 2 + [2.0] + [10.0, 10.0, 10.0, 3.0])

_AFTER = 0.6
"""Time after a row, in sample times, after which a servo has practically reached a held command."""


def identified(car: VirtualCar, rides: list[Ride]) -> VirtualCar:
    """The vehicle with identified tyres, yaw inertia, resistance and drive, as an engineer would obtain them.

    Mass, geometry and axle shares are measured; the others are fitted by least squares to the accelerations of the
    nominal vehicle in noise-free manoeuvres, each divided by its standard deviation.

    Parameters
    ----------
    car : with approximate parameters.
    rides : of the nominal vehicle, without withheld effects.
    """
    truth = [ride.truth(_AFTER * ride.period) for ride in rides]  # when the servo has reached its command
    joined = {name: np.concatenate([item[name] for item in truth]) for name in truth[0]}
    steer, drive = (np.concatenate([ride.arriving(k, _AFTER) for ride in rides]) for k in (0, 1))
    moving = (joined["v_x"] > 0.15 * car.top_speed) & (np.arange(len(steer)) % 3 == 0)
    joined = {name: item[moving] for name, item in joined.items()}
    steer, drive = steer[moving], drive[moving]
    weights = {name: 1.0 / max(float(np.std(joined[name])), 1e-9) for name in ("a_x", "a_y", "yaw_acceleration")}
    p = dict(car.parameters)

    def stated(x: Row) -> dict[str, float]:
        value = dict(zip(_TYRES, map(float, x[:8]), strict=True))
        value["I_z"] = p["I_z"] * float(x[8])
        scales = (p["m"] * 0.1, p["m"] * 0.1 / car.top_speed, p["m"] / car.top_speed**2, p["force_per_unit"])
        return p | value | dict(zip(("c_0", "c_1", "c_2", "force_per_unit"), scales * x[9:], strict=True))

    def residuals(x: Row) -> Row:
        a = accelerations(stated(x), joined, steer, drive)
        gone = [weights[name] * (a[name] - joined[name]) for name in weights]
        held = 0.01 * (x[8] - 1.0) * np.sqrt(len(steer)), 1e-3 * np.sqrt(len(steer)) * x[10]
        return np.concatenate([*gone, held])

    begin = np.array([*(p[name] for name in _TYRES), 1.0, p["c_0"] / (p["m"] * 0.1), 0.0,
                      p["c_2"] * car.top_speed**2 / p["m"], 1.0])  # fmt: skip
    result = least_squares(residuals, np.clip(begin, _LEAST + 1e-6, _MOST - 1e-6), bounds=(_LEAST, _MOST), max_nfev=40)
    return replace(car, parameters={name: float(f"{item:.6g}") for name, item in stated(result.x).items()})


def accelerations(p: dict[str, float], at: dict[str, Row], steer: Row, drive: Row) -> dict[str, Row]:
    """a_x, a_y and yaw acceleration of the single track in a given motion, (n,) each."""
    v_x, v_y, r, L = at["v_x"], at["v_y"], at["yaw_rate"], p["l_f"] + p["l_r"]
    alpha = {"f": steer - np.arctan2(v_y + p["l_f"] * r, v_x), "r": -np.arctan2(v_y - p["l_r"] * r, v_x)}
    F_y = {}
    for axle, arm in (("f", p["l_r"]), ("r", p["l_f"])):
        B, C, D, E = (p[f"{name}_{axle}"] for name in "BCDE")
        x = B * alpha[axle]
        F_y[axle] = p["m"] * 9.81 * arm / L * D * np.sin(C * np.arctan(x - E * (x - np.arctan(x))))
    F = p["force_per_unit"] * drive
    share = np.where(F >= 0.0, p["drive_split_front"], p["brake_split_front"])
    along, c, s = share * F, np.cos(steer), np.sin(steer)
    across = F_y["f"] * c + along * s
    resistance = p["c_0"] * np.tanh(v_x / 0.1) + p["c_1"] * v_x + p["c_2"] * v_x * np.abs(v_x)
    return {
        "a_x": ((1.0 - share) * F + along * c - F_y["f"] * s - resistance) / p["m"],
        "a_y": (F_y["r"] + across) / p["m"],
        "yaw_acceleration": (p["l_f"] * across - p["l_r"] * F_y["r"]) / p["I_z"],
    }


PERIODS = (0.010, 0.020)
"""Sample times, s."""
DURATION, HELD_OUT, REFERENCE = (60.0, 100.0), (40.0, 60.0), 45.0
"""Durations of recordings, and of the manoeuvres for identification, s."""
FORM_MOST = 0.02
"""Largest model error, relative to the sd of the signal, with which a vehicle is accepted: beyond it, the identified
single track does not describe the vehicle."""
ROUGH_MOST = 0.2
"""Likewise for rough files: beyond it, nobody would have handed out the file."""
FORM_CHANNELS = ("v_x", "yaw_rate", "a_x", "a_y")
DRAWS = 12
"""Most draws of vehicle, magnitudes and drive until every effect is detectable; the last one is used in any case."""


def made(planned: Planned) -> MadeCase:
    """Make a case; see `fair_case`."""
    what = f" with {', '.join(planned.effects)}" if planned.effects else ""
    return fair_case(partial(_ForeignCase, planned), DRAWS, f"vehicles of the family {planned.family}{what}")


class _ForeignCase(Draw):
    tolerances: Tolerances
    outside = OUTSIDE

    def __init__(self, planned: Planned, attempt: int) -> None:
        super().__init__(planned, attempt)
        self.family, rng = FAMILIES[planned.family], self.rng
        self.known = {name: entry for name, entry in VOCABULARY.items() if name in self.family.effects}
        self.rate = 1.0 / float(rng.choice(PERIODS))
        vehicle = self.family.draw(rng, planned.number + attempt // DRAWS)  # of another class if one is not possible
        self.vehicle = vehicle = replace(vehicle, about=with_lateral_velocity(vehicle.about, planned.effects))
        self.stated = self._identified()
        self.tolerances = tolerances(self.stated)
        if self.family.rough:
            self.true, self.numbers = self.stated, dict(vehicle.numbers)
            self.stated, errors = roughened(self.stated, rng)
            self.nature = (*self.family.nature, *errors)
        else:
            self.true = toleranced(self.stated, rng)
            self.numbers = _shifted(vehicle.numbers, self.stated, self.true)
        self.drawn = {name: magnitude(name, self.stated, rng) for name in planned.effects}
        self.effects = dict(self.drawn)
        if "wind_gust" in self.drawn:
            self.effects["wind_direction"] = float(rng.uniform(-np.pi, np.pi))
        self.seed, self.other_seed = (int(item) for item in rng.choice(2**31 - 1, 2, replace=False))
        self._drive()
        if planned.kind == "many":
            self.resize()
            self._drive()

    def _drive(self) -> None:
        self.ride = self._driven(DURATION, self.seed)
        self.recording = self._recorded(self.ride, self.seed)
        self.__dict__.pop("_base", None)  # of the previous ride
        noise, rows = self.stated.noise, len(self.recording)
        self.again = Replays(self._driven_again, noise, rows, self.ride.period, self.tolerances, self._form())

    def _reality(self, effects: Mapping[str, float], seed: int, numbers: Mapping[str, float]) -> Reality:
        value = withheld(numbers, effects, self.vehicle.about)
        return self.family.build(value, gusts(6000, seed) if effects.get("crosswind") else np.zeros(1))

    def _identified(self) -> VirtualCar:
        """The single track identified from the nominal vehicle; if it does not fit well, the draw is rejected."""
        about = self.vehicle.about
        rides = [
            driven(self._reality({}, 0, self.vehicle.numbers), about, REFERENCE, 50.0, int(integer))
            for integer in self.rng.integers(2**31, size=3)
        ]
        stated = identified(about, rides[:2])
        proof = rides[2]
        flat = DoubleTrack(single_track(stated, proof.linear_hold))
        model = replayed(flat, about, proof.commands, proof.period, proof.start)
        real, modelled = readings(proof, about, {}, 0), readings(model, about, {}, 0)
        self.form = {
            name: float(np.std(modelled[name] - real[name]) / (np.std(real[name]) + 1e-9)) for name in FORM_CHANNELS
        }
        if max(self.form.values()) > (ROUGH_MOST if self.family.rough else FORM_MOST):
            raise BadInput("The single track that was identified does not describe the vehicle.")
        return stated

    def _driven(self, duration: tuple[float, float], seed: int) -> Ride:
        everything = together(self.true.small, self.effects)
        reality = self._reality(everything, seed, self.numbers)
        return driven(reality, self.stated, float(self.rng.uniform(*duration)), self.rate, seed)

    def _recorded(self, ride: Ride, seed: int) -> Recording:
        return recorded(ride, self.stated, together(self.true.small, self.effects), seed, self.planned.case)

    def _driven_again(self, effects: Mapping[str, float], rows: int, beyond: str) -> Mapping[str, Array]:
        """Simulation of another vehicle with the recording's commands, see `replays.Drive`.

        The influence of tolerances is simulated with the stated single track.
        """
        everything = together(self.true.small, effects)
        if beyond:
            real, flat = self._base
            car, small = self.stated, {}
            known = self.tolerances
            if beyond in known.parameters:
                moved = car.parameters[beyond] + known.parameters[beyond]
                car = replace(car, parameters={**car.parameters, beyond: moved})
            else:
                small[beyond] = ENTRIES[beyond].null + known.effects[beyond]
            further = self._stated(rows, car, small)
            return {name: real[name] + further[name] - flat[name] for name in self.stated.noise}
        commands = self.ride.commands[:rows]
        reality = self._reality(everything, self.seed, self.numbers)
        ride = replayed(reality, self.stated, commands, self.ride.period, self.ride.start)
        return readings(ride, self.stated, everything, self.seed)

    @cached_property
    def _base(self) -> tuple[Mapping[str, Array], Mapping[str, Array]]:
        """Readings with the recording's commands, of the vehicle without withheld effects and as stated."""
        rows = len(self.recording)
        return self._driven_again({}, rows, ""), self._stated(rows, self.stated, {})

    def _stated(self, rows: int, car: VirtualCar, effects: Mapping[str, float]) -> Mapping[str, Array]:
        """Readings of a single track with the recording's commands."""
        numbers = withheld(single_track(car, self.ride.linear_hold), effects, car)
        commands = self.ride.commands[:rows]
        ride = replayed(DoubleTrack(numbers), car, commands, self.ride.period, self.ride.start)
        return readings(ride, car, effects, self.seed)

    def _form(self) -> Array:
        """Difference of the nominal vehicle from the stated one with the recording's commands, in noise sds."""
        rows = len(self.recording)
        nominal = self._reality({}, self.seed, self.vehicle.numbers)
        ride = replayed(nominal, self.stated, self.ride.commands, self.ride.period, self.ride.start)
        real, flat = readings(ride, self.stated, {}, self.seed), self._stated(rows, self.stated, {})
        return np.stack([(real[name] - flat[name]) / sd for name, sd in self.stated.noise.items()])

    def made(self) -> MadeCase:
        """The case with its answer."""
        held_out = self._recorded(self._driven(HELD_OUT, self.other_seed), self.other_seed)
        withheld = together({k: v for k, v in self.true.small.items() if k in self.drawn}, self.drawn)
        car = {"kind": self.stated.kind, "parameters": dict(self.true.parameters), "small": dict(self.true.small),
               "numbers": dict(self.numbers), "noise": dict(self.stated.noise)}  # fmt: skip
        about = {"family": self.planned.family, "rate": self.rate}
        hold = columns_text("linear" if self.ride.linear_hold else "zero")
        return self.case(held_out, withheld, car, about, {"form_error": self.form}, hold)


def _shifted(numbers: Mapping[str, float], stated: VirtualCar, true: VirtualCar) -> dict[str, float]:
    """Numbers of a vehicle, changed from the identified one as the true single track differs from the stated one."""
    result, before, after = dict(numbers), chassis(stated), chassis(true)
    for name, value in before.items():
        if name in ("drive_split_front", "brake_split_front"):
            result[name] = min(max(result[name] + after[name] - value, 0.0), 1.0)
        elif value != 0.0:
            result[name] = result[name] * after[name] / value
    return result
