"""Vehicles on a track, many side by side: what a driver sees, does, and is paid for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array, Mask
from greybox_id.models.motion_model import MotionModel

from .draws import Draws, nothing_drawn
from .rules import REMEMBERED, USAGE, Rules
from .stage import PLANE, Period, stage
from .track import RaceTrack, Usage, track

if TYPE_CHECKING:
    from .lidar import Lidar

Places = NDArray[np.intp]
Observations = NDArray[np.float32]

AHEAD = np.linspace(0.1, 1.0, 10)
"""Seconds ahead, at the present speed, at which a driver sees the track."""
LARGEST = 10.0
"""What a number of an observation is at most: only vehicles that go astray come near it."""
OWN = 7
"""Numbers of an observation that are not of the track ahead."""
SEEN = (
    *("v_x", "v_y", "yaw_rate", "e_y", "sin_e_psi", "last_steering", "last_drive"),
    *(f"curvature_in_{seconds:.1f}s" for seconds in AHEAD),
    *(f"speed_in_{seconds:.1f}s" for seconds in AHEAD),
)
"""What the numbers of an observation are, each over its unit of `World.units`."""
DRIVE, BRAKE = 0.4, 0.7
"""Largest accelerations over the grip where nothing is said: motors of 1:10 cars and road cars; brakes of either."""
NARROWEST, HALF_WIDTH = 4.0, 3.0
"""Radius of the narrowest bend and half width of the track over the wheelbase: 1.3 m and 1 m of a 1:10 car."""
FASTEST = 2.5
"""Top speed over that in the narrowest bend."""
HALF_CAR = 0.35
"""Half width of a vehicle over its wheelbase where no track width is stated: 1.8 m of 2.7 m."""
SPUN, HALTED, HALTED_FOR = 1.0, 0.2, 1.0
"""Sideslip, rad, speed, m/s, and s at it, at which an episode ends."""
CRASH, BEYOND, OFF, HASTY, LIMIT = -10.0, 1.0, 0.5, 0.05, 0.98
"""Reward of a crash; weights of driving beyond `LIMIT` of the grip, beside the path, and hastily."""
SLOWEST_WANTED = 0.5
"""Speed, m/s, that an action of -1 stands for where actions are speeds."""
REACHED = 10.0
"""Periods in which a wanted speed is driven to."""
AT_ONCE = 2
"""Commands that are kept where none is late: the newest and the one before it."""
BESIDE_RANGES = 4
"""Numbers that are seen beside ranges: v_x, yaw rate and the last actions."""


class World:
    """Vehicles on one track, a period at a time.

    Parameters
    ----------
    model : of motion, with its effects, at the values that are believed.
    lanes : how many vehicles drive side by side; they do not see each other.
    rules : how drivers act and are paid.
    line : the track; None: that of the examples, scaled to the vehicle.
    draws : what of the vehicle differs from episode to episode.
    sd : standard deviation of the readings of v_x, v_y and yaw rate.
    steer_max : rad.
    like : a world whose track, and whose units of what is seen and done, are this one's as well: a driver of another
        model of the same vehicle.

    Attributes
    ----------
    z : (L, n + 3) states, s, e_y and e_psi.
    lanes : (L,) generators of what is random in each.
    steer_max : rad, the road-wheel angle that a steering of 1 stands for.
    track, limits : where they drive, and what of the vehicle the speed on it uses.
    edge : m from the middle line to where a vehicle's centre of gravity leaves the track.
    size : how many numbers an observation has.

    Raises
    ------
    BadInput : the model moves along no path, the track is too narrow, or a number makes no sense.
    """

    z: Array
    track: RaceTrack
    _p: Array
    _delay: Array
    _given: Array
    _last: Array
    _from: Array
    _period: Places
    _halted: Array
    _strength: Array
    _pace: Array
    _noise: Array
    _past: Array
    _ranges: Array
    _sight: Array
    _unseen: Array

    def __init__(
        self,
        model: MotionModel,
        lanes: int,
        rules: Rules | None = None,
        *,
        line: RaceTrack | None = None,
        draws: Draws | None = None,
        sd: Mapping[str, float] | None = None,
        steer_max: float,
        like: World | None = None,
    ) -> None:
        self.rules, self.draws = rules or Rules(), draws or nothing_drawn()
        model = self.draws.suited(model)
        self.stage = stage(model, self.rules.period, self.draws.names)
        self._moving = [parameter.name for parameter in self.stage.equations.parameters]
        self.limits, self._per_drive = limits_of(self.stage, model)
        wheelbase = float(model["l_f"].array + model["l_r"].array)
        self._nominal_grip = self.stage.begun(1.0, self.stage.equations.values)[2]
        self.track = (
            like.track
            if like is not None
            else line or track(NARROWEST * wheelbase, HALF_WIDTH * wheelbase, self.limits)
        )
        half_car = 0.625 * float(model["track_f"].array) if "track_f" in model else HALF_CAR * wheelbase
        self.edge = self.track.half_width - half_car
        if not self.edge > 0:
            raise BadInput(
                f"A track {2 * self.track.half_width:.3g} m wide is too narrow for a vehicle of {2 * half_car:.3g} m."
            )
        drive, brake = (share * self._nominal_grip for share in (DRIVE, BRAKE))
        self._drives = np.array([brake / self._per_drive[1], drive / self._per_drive[0]])
        self.steer_max = steer_max
        self._sd = np.array([(sd or {}).get(name, 0.0) for name in PLANE])
        self._steer, self._drive = (self.stage.inputs.index(name) for name in ("steer", self.stage.drive))
        self._plane = [self.stage.states.index(name) for name in PLANE]
        self._top = float(np.max(self.track.speed))
        bends = self.track.curvature
        self._bends = np.stack([bends, np.roll(bends, -1) - bends], axis=1)
        columns = [self.track.curvature * self.track.half_width, self.track.speed / self._top]
        self._seen = np.stack([values for c in columns for values in (c, np.roll(c, -1) - c)], axis=1)
        self._turning = self.limits.grip / float(np.min(self.track.speed))
        if like is not None:
            self._drives, self._per_drive, self._turning = like._drives, like._per_drive, like._turning
        self._lidar: Lidar | None = None
        if self.rules.observation == "lidar":
            from .lidar import Lidar  # its compiler takes a second to import

            self._lidar = Lidar(self.track)
        self.size = len(SEEN) if self._lidar is None else self._lidar.beams + BESIDE_RANGES
        self.size += REMEMBERED * self.rules.memory
        self.lanes = [np.random.default_rng(k) for k in range(lanes)]
        self._begun(lanes)

    @property
    def units(self) -> dict[str, float]:
        """What numbers of observations and actions of 1 stand for: m/s, rad/s, m and rad; curvature: half widths."""
        return {
            "speed": self._top,
            "yaw_rate": self._turning,
            "half_width": self.track.half_width,
            "steer": self.steer_max,
        }

    @property
    def inputs(self) -> tuple[int, int]:
        """Columns of steering and drive among commands."""
        return self._steer, self._drive

    @property
    def drives(self) -> tuple[float, float]:
        """Largest braking and drive, in the drive's unit."""
        return float(self._drives[0]), float(self._drives[1])

    def reset(self, which: Mask, seeds: Sequence[int | None] | None = None) -> None:
        """Let vehicles begin anew; those that are given a seed draw everything from it from then on."""
        for k in np.flatnonzero(which).tolist():
            if seeds is not None and seeds[k] is not None:
                self.lanes[k] = np.random.default_rng(seeds[k])
            self._begin(k)
        self._scan(which)

    def observe(self) -> Observations:
        """(L, size) what drivers see, see `Rules.observation`, and what they remember."""
        motion = self._read()
        if self._lidar is None:
            seen = self.seen(motion, self.z[:, -3:], self._last)
        else:
            turning = motion[:, [0, 2]] / [self._top, self._turning]
            seen = _within(np.concatenate([self._ranges, turning, self._last], axis=1))
        if self.rules.memory:
            seen = np.concatenate([seen, _within(self._past.reshape(len(seen), -1))], axis=1)
        return seen

    def seen(self, motion: Array, place: Array, last: Array) -> Observations:
        """(L, 27) what drivers see of any vehicle on the track: speeds, place, last actions, and the track ahead.

        Parameters
        ----------
        motion : (L, 3) v_x, v_y, m/s, and yaw rate, rad/s, as they are read.
        place : (L, 3) s, e_y, m, and e_psi, rad.
        last : (L, 2) the last actions.
        """
        s, e_y, e_psi = place.T
        seen = np.empty((len(place), len(SEEN)), dtype=np.float32)
        seen[:, :3] = motion / [self._top, self._top, self._turning]
        seen[:, 3] = e_y / self.track.half_width
        seen[:, 4] = np.sin(e_psi)
        seen[:, 5:OWN] = last
        places = s[:, None] + np.maximum(motion[:, :1], SLOWEST_WANTED) * AHEAD
        middle = OWN + len(AHEAD)
        seen[:, OWN:middle], speed = self._ahead(places)
        seen[:, middle:] = np.minimum(self._pace[:, None] * speed, self.rules.speed_cap / self._top)
        return _within(seen)

    def step(self, actions: Array, still: Mask | None = None) -> tuple[Array, Mask, Mask]:
        """Drive a period.

        Parameters
        ----------
        actions : (L, 2) steering and drive or speed, -1 to 1; what is beyond is clipped, what is no number is zero.
        still : lanes in which nothing happens.

        Returns
        -------
        reward : (L,).
        ended : (L,) whether the vehicle left the track, spun, halted or went beyond all numbers.
        cut : (L,) whether its time is over or its laps are driven.
        """
        moving: Mask = np.ones(len(self.z), dtype=np.bool_) if still is None else ~still
        given = np.clip(np.nan_to_num(np.asarray(actions, dtype=float), nan=0.0), -1.0, 1.0)
        before = self.z
        if self.rules.memory:
            now = self._remembered(given[:, 0], self._read())
            past = np.concatenate([now[:, None], self._past[:, :-1]], axis=1)
            self._past = np.where(moving[:, None, None], past, self._past)
        with np.errstate(all="ignore"):  # vehicles that go astray end their episode
            after = self.stage.advance(before, self._acting(given, moving), self._bend(before), self._p)
            lost = ~np.all(np.isfinite(after), axis=1)
            after[lost] = before[lost]
            self.z = np.where(moving[:, None], after, before)
            if self._sight.shape[1]:
                shown = np.concatenate([self.z[:, None, self._plane], self._sight[:, :-1]], axis=1)
                self._sight = np.where(moving[:, None, None], shown, self._sight)
            reward, ended, lapped = self._judged(before, self.z, given, lost)
        self._last = np.where(moving[:, None], given, self._last)
        self._period += moving
        self._scan(moving)
        cut = (self._period * self.rules.period >= self.rules.seconds - 1e-9) | (lapped >= self.rules.laps)
        return np.where(moving, reward, 0.0), ended & moving, cut & ~ended & moving

    def commanded(self, actions: Array, v_x: Array, s: Array) -> Array:
        """(L, inputs) commands that actions from -1 to 1 stand for.

        Parameters
        ----------
        actions : (L, 2) steering and drive or speed.
        v_x, s : (L,) m/s and m, where the vehicles are.
        """
        commands = np.zeros((len(actions), len(self.stage.inputs)))
        commands[:, self._steer] = actions[:, 0] * self.steer_max
        commands[:, self._drive] = self._driven(actions[:, 1], v_x, s)
        return commands

    def situation(self) -> dict[str, Array]:
        """What is known of every lane beside what its driver sees: s and e_y, m, and the laps driven."""
        return {"s": self.z[:, -3].copy(), "e_y": self.z[:, -2].copy(), "laps": self._laps(self.z)}

    def _begun(self, lanes: int) -> None:
        entry, periods = self.stage, int(np.ceil(self.rules.seconds / self.rules.period)) + 1
        self.z = np.zeros((lanes, entry.size + 3))
        self._p = np.zeros((lanes, len(entry.equations.values)))
        self._delay = np.zeros((lanes, len(entry.inputs)))
        latest = max(self.draws.delay, float(np.max(entry.begun(1.0, entry.equations.values)[1])))
        longest = int(np.ceil(latest / self.rules.period)) + AT_ONCE
        self._given = np.zeros((lanes, longest, len(entry.inputs)))
        unseen = max(self.draws.latency, float(np.max(entry.latencies(entry.equations.values))))
        kept = int(np.ceil(unseen / self.rules.period)) + AT_ONCE if unseen > 0 else 0
        self._sight, self._unseen = np.zeros((lanes, kept, len(PLANE))), np.zeros((lanes, len(PLANE)))
        self._last = np.zeros((lanes, 2))
        self._from = np.zeros(lanes)
        self._period = np.zeros(lanes, dtype=np.intp)
        self._halted = np.zeros(lanes)
        self._strength, (low, high) = np.zeros(lanes), self.rules.shares
        self._pace = np.full(1 if low == high else lanes, np.sqrt(high / USAGE))  # one for all where none is drawn
        self._noise = np.zeros((lanes, periods if self.rules.noise else 1, len(PLANE)))
        self._past = np.zeros((lanes, self.rules.memory, REMEMBERED))
        self._ranges = np.zeros((lanes, 0 if self._lidar is None else self._lidar.beams))
        self.reset(np.ones(lanes, dtype=bool))

    def _begin(self, k: int) -> None:
        """Put a vehicle on the track: anywhere, a little beside the line, at half the speed there or more."""
        generator = self.lanes[k]
        where, beside, aslant, fast = generator.random(4)
        drawn = self.draws.draw(generator)
        self._p[k] = [drawn[name] for name in self._moving]
        low, high = self.rules.shares
        if low < high:
            self._pace[k] = np.sqrt((low + (high - low) * generator.random()) / USAGE)
        s, pace = where * self.track.length, float(self._pace[k % len(self._pace)])
        target = min(pace * float(self.track.line("speed", np.array([s]))[0][0]), self.rules.speed_cap)
        v_x = max((0.5 + 0.4 * fast) * target, SLOWEST_WANTED)
        self.z[k, :-3], late, self._strength[k] = self.stage.begun(v_x, self._p[k])
        self._delay[k] = np.clip(late, 0.0, (self._given.shape[1] - AT_ONCE) * self.rules.period)
        self.z[k, -3:] = s, 0.3 * (2 * beside - 1) * self.edge, 0.1 * (2 * aslant - 1)
        self._given[k], self._last[k], self._from[k] = 0.0, 0.0, s
        if self._sight.shape[1]:
            self._sight[k] = self.z[k, self._plane]
            longest = (self._sight.shape[1] - AT_ONCE) * self.rules.period
            self._unseen[k] = np.clip(self.stage.latencies(self._p[k]), 0.0, longest)
        self._period[k], self._halted[k] = 0, 0.0
        if self.rules.noise:
            self._noise[k] = generator.normal(size=self._noise.shape[1:]) * self._sd
        self._past[k] = self._remembered(np.zeros(1), self.z[k : k + 1, self._plane])  # it has driven straight on

    def _scan(self, which: Mask) -> None:
        """Let lidars look around."""
        if self._lidar is None:
            return
        lanes = np.flatnonzero(which)
        result = self._lidar.scan(self.z[lanes, -3:])
        if self.rules.noise:
            result = self._lidar.noisy(result, [self.lanes[k] for k in lanes])
        self._ranges[lanes] = result / self._lidar.range

    def _remembered(self, steering: Array, motion: Array) -> Array:
        """(L, 3) what drivers keep in mind of a period."""
        return np.stack([steering, motion[:, 2] / self._turning, motion[:, 0] / self._top], axis=1)

    def _acting(self, given: Array, moving: Mask) -> Array:
        """(L, inputs) what acts over the period, of the commands that are on their way."""
        commands = self.commanded(given, self.z[:, self._plane[0]], self.z[:, -3])
        if self._given.shape[1] == AT_ONCE:
            return commands
        moved = np.concatenate([commands[:, None], self._given[:, :-1]], axis=1)
        self._given = np.where(moving[:, None, None], moved, self._given)
        return between(moved, self._delay / self.rules.period)

    def _read(self) -> Array:
        """(L, 3) motion as sensors read it now: late by fractions of a period too, and with their noise."""
        late = bool(self._sight.shape[1])
        motion = between(self._sight, self._unseen / self.rules.period) if late else self.z[:, self._plane]
        if self.rules.noise:
            rows = self._period % self._noise.shape[1]
            motion = motion + self._noise[np.arange(len(rows)), rows]
        return np.asarray(motion)

    def _driven(self, action: Array, v_x: Array, s: Array) -> Array:
        """What drives, in its unit."""
        if self.rules.action == "drive":
            result: Array = np.where(action < 0, action * self._drives[0], action * self._drives[1])
        else:
            target = SLOWEST_WANTED + 0.5 * (action + 1.0) * (self._top - SLOWEST_WANTED)
            result = self._towards(np.minimum(target, self.rules.speed_cap), v_x)
        if np.isfinite(self.rules.usage_cap):
            fastest = (self.rules.usage_cap / USAGE) ** 0.5 * self._top * self._ahead(s)[1]
            result = np.minimum(result, self._towards(fastest, v_x))
        return result

    def _towards(self, target: Array, v_x: Array) -> Array:
        """What drives to a wanted speed, in its unit."""
        wished = (target - v_x) / (REACHED * self.rules.period)
        units = np.where(wished < 0, wished / self._per_drive[1], wished / self._per_drive[0])
        return np.clip(units, -self._drives[0], self._drives[1])

    def _bend(self, z: Array) -> Array:
        s = z[:, -3]
        at = s / self.track.spacing
        k = np.floor(at).astype(int)
        result = self._bends.take(k, axis=0, mode="wrap")
        return np.stack([result[:, 0] + (at - k) * result[:, 1], result[:, 1] / self.track.spacing, s], axis=1)

    def _ahead(self, places: Array) -> tuple[Array, Array]:
        """Curvature times half width, and speed over the top speed, at places on the track."""
        at = places / self.track.spacing
        k = at.astype(int)
        result = self._seen.take(k, axis=0, mode="wrap")
        share = at - k
        return result[..., 0] + share * result[..., 1], result[..., 2] + share * result[..., 3]

    def _laps(self, z: Array) -> Array:
        return np.floor((z[:, -3] - self._from) / self.track.length)

    def _judged(self, before: Array, after: Array, given: Array, lost: Mask) -> tuple[Array, Mask, Array]:
        """Reward, whether the vehicle crashed, and laps driven."""
        (v_x, v_y, turning), (s, e_y, e_psi) = after[:, self._plane].T, after[:, -3:].T
        T, was = self.rules.period, before[:, self._plane].T
        self._halted = np.where(v_x < HALTED, self._halted + T, 0.0)
        ended = lost | (np.abs(e_y) > self.edge) | (np.abs(np.arctan2(v_y, np.maximum(v_x, 1e-3))) > SPUN)
        ended |= self._halted >= HALTED_FOR - 1e-9
        laps = self._laps(after)
        if self.rules.reward == "cth":
            wall = np.maximum(1.0 - (self.track.half_width - np.abs(e_y)) / 0.3, 0.0)
            reward = 0.2 * v_x * np.cos(e_psi) - 0.1 * np.abs(e_y) - 0.5 * np.abs(given[:, 0] - self._last[:, 0])
            reward += 0.01 - 0.5 * wall + 10.0 * (laps > self._laps(before))
            return np.where(ended, CRASH, reward), ended, laps
        if self.rules.reward == "path":
            target = np.minimum(self._pace * self._top * self._ahead(s)[1], self.rules.speed_cap)
            reward = 1.0 - np.abs(v_x * np.cos(e_psi) - v_y * np.sin(e_psi) - target) / target
            off = self.rules.follow * (e_y / self.track.half_width) ** 2
            reward -= off / (1.0 + off)  # bounded: to crash is never the better way out
        else:
            reward = (s - before[:, -3]) / (self._top * T) - OFF * (e_y / self.track.half_width) ** 2
        along, across = (v_x - was[0]) / T - v_y * turning, (v_y - was[1]) / T + v_x * turning
        reward -= HASTY * np.sum((given - self._last) ** 2, axis=1)
        reward -= BEYOND * (np.hypot(along, across) > LIMIT * self._strength)
        return np.where(ended, CRASH, reward), ended, laps


def _within(seen: NDArray[Any]) -> Observations:
    result: Observations = np.clip(seen, -LARGEST, LARGEST).astype(np.float32, copy=False)
    return result


def between(held: Array, late: Array) -> Array:
    """What was so many periods ago, straight between two.

    Parameters
    ----------
    held : (L, periods, n), the newest first.
    late : (L, n) periods.
    """
    whole = late.astype(int)
    share = late - whole
    rows, columns = np.arange(len(held))[:, None], np.arange(held.shape[2])
    early, later = held[rows, whole, columns], held[rows, np.minimum(whole + 1, held.shape[1] - 1), columns]
    return np.asarray((1.0 - share) * early + share * later)


def limits_of(period: Period, model: MotionModel) -> tuple[Usage, tuple[float, float]]:
    """What of a vehicle the speed on a track uses, and its acceleration per unit of drive and of braking."""
    grip = period.begun(1.0, period.equations.values)[2]
    if not grip > 0:
        raise BadInput(f"Model {model.name} has no grip: check the parameters of its tyres.")
    wheelbase = float(model["l_f"].array + model["l_r"].array)
    used = USAGE * grip
    fastest = FASTEST * float(np.sqrt(used * NARROWEST * wheelbase))
    return Usage(used, DRIVE * used, BRAKE * used, fastest), period.per_drive(period.equations.values)
