"""The answer of a diagnosis: where simulation and vehicle part, which effect causes it, how far it shrinks with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from math import isfinite, nan, sqrt
from typing import Any

from ..engine.simulation import Diagnosed
from ..fitting.scores.horizons import Errors
from .estimation.calibration import CAL
from .estimation.strip import Strip
from .estimation.wandering import Wander

CHANNELS = ("v_x", "v_y", "yaw_rate", "a_x", "a_y")
"""What a diagnosis looks at, in this order."""

REGIMES = (
    *("any", "straight", "lateral", "high_lateral", "transient", "acceleration", "braking", "combined", "high_speed"),
    "time_drift",
)
"""Where a gap may lie, in words of driving."""


@dataclass(frozen=True)
class Where:
    """Where a gap lies.

    Attributes
    ----------
    channel : the channel that deviates most; one of `CHANNELS`, "" where there is no gap.
    regime : the regime it prefers; one of `REGIMES`.
    equations : part of the equations ("steering", "F_y", "sensors" ...) -> its share of what could be gained.
    time : "from", "to" [s]: the shortest stretch that holds half of the gap; "share": of the recording's duration.
        Where clocks begin anew, runs are laid one behind the other.
    channels : channel -> root mean square of its errors over that of its noise.
    regimes : regime -> (share of the time, share of the gap).
    """

    channel: str = ""
    regime: str = "any"
    equations: Mapping[str, float] = field(default_factory=dict)
    time: Mapping[str, float] = field(default_factory=dict)
    channels: Mapping[str, float] = field(default_factory=dict)
    regimes: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Ranked:
    """One effect as a cause.

    Attributes
    ----------
    effect : its name.
    probability : that it is present.
    magnitude, unit, interval : its estimate, its unit, 95 % interval.
    indistinguishable_from : effects this recording cannot tell it from.
    gain : of the log-likelihood over the model without it, beside the other applied effects.
    reason : why it is not applied though it is of the best explanation, or surely there; "" otherwise.
    since, until : s, by the clock of `within`, where it begins or ends there; None where it acts from the start, or to
        the end.
    within : name of the recording, and of its run if it has several, in which it begins or ends; "" where it acts
        everywhere.
    others : its second parameters that are elsewhere than usual, by name: where wind blows to.
    """

    effect: str
    probability: float
    magnitude: float
    unit: str
    interval: tuple[float, float]
    indistinguishable_from: tuple[str, ...] = ()
    gain: float = 0.0
    reason: str = ""
    since: float | None = None
    until: float | None = None
    within: str = ""
    others: Mapping[str, float] = field(default_factory=dict)

    @property
    def lasts(self) -> bool:
        """Whether it acts at the end of the recordings, so that a vehicle as it then is has it."""
        return self.until is None


@dataclass(frozen=True)
class CauseClass:
    """Effects that act alike on these recordings, one of which is there.

    Which act alike is worked out from the recordings: each member, in the place of the first and everything else
    refitted, explains them as well.

    Attributes
    ----------
    members : likeliest first.
    probability : that one of them is there.
    each : member -> probability that it is the one.
    applied : the member that the closed model has; "" where it has none.
    """

    members: tuple[str, ...]
    probability: float
    each: Mapping[str, float]
    applied: str = ""


@dataclass(frozen=True)
class Closure:
    """How far a gap shrinks.

    Attributes
    ----------
    before, after, floor : mean square of the errors over that of the noise, all channels alike; the floor is one, or
        less where less is left.
    closed : (before - after) / (before - floor); negative where the effect makes predictions worse.
    closed_interval : 95 %, from paired blocks.
    recordings : names of those it was measured on.
    errors : per channel and horizon.
    """

    before: float
    after: float
    floor: float
    closed: float
    closed_interval: tuple[float, float]
    recordings: tuple[str, ...] = ()
    errors: tuple[Errors, ...] = ()

    @property
    def shows(self) -> bool:
        """Whether there is enough of a gap in free run, tolerances refitted, that shares of it say something."""
        return bool(max(self.before, self.after) - self.floor >= CAL.shows)


@dataclass(frozen=True)
class Share:
    """Share of the excess error that an effect closes, with its 95 % interval from paired blocks."""

    effect: str
    share: float
    low: float
    high: float


@dataclass(frozen=True)
class Budget:
    """Where the excess error goes.

    Attributes
    ----------
    shares : of the effects that were found, in their order.
    unnamed : of what no effect closes; its name is "unexplained".
    recordings : on which it was measured.
    held_out : whether these chose nothing.
    shows : whether there is enough of it that shares say something.
    beside : of each effect, which share it closes of the excess that all others leave.
    together : held out, how far all of them close it: by the same refits, or a page has two answers.
    """

    shares: tuple[Share, ...]
    unnamed: Share
    recordings: tuple[str, ...]
    held_out: bool
    shows: bool = True
    beside: tuple[Share, ...] = ()
    together: Closure | None = None

    def of(self, effect: str) -> Share | None:
        """The share of an effect."""
        return next((share for share in self.shares if share.effect == effect), None)

    def judged(self, effect: str) -> Share | None:
        """What an effect is judged by: what it closes of what all others leave; small causes stand beside large ones.

        Its share of the whole where the others are not known to be causes: of an effect alone both are the same.
        """
        return next((share for share in self.beside if share.effect == effect), self.of(effect))

    def to_json(self) -> list[dict[str, Any]]:
        """One object per effect, and one for the unexplained rest."""
        rows: list[dict[str, Any]] = [
            {"effect": share.effect, "share": share.share, "low": share.low, "high": share.high}
            for share in self.shares
        ]
        return [*rows, {"unnamed": self.unnamed.share, "low": self.unnamed.low, "high": self.unnamed.high}]


@dataclass(frozen=True)
class Unnamed:
    """Model error that is left beside the best explanation, and what nuisances and noise say of it.

    Attributes
    ----------
    share_y, share_x : standard deviation of unknown lateral and longitudinal forces, over the forces themselves.
    floor_y, floor_x : of those beside that, m/s^2.
    memory_y, memory_x : their correlation times, s.
    tolerances : what nuisances cost, twice their negative logarithm of prior; chi-square about `expected` where
        everything is as stated.
    worst : the nuisance that is furthest from its mean, and by how many standard deviations.
    noise : channel -> noise over what is stated.
    expected : how many nuisances the recordings tell of; NaN in files of before.
    """

    share_y: float
    share_x: float
    floor_y: float
    floor_x: float
    memory_y: float
    memory_x: float
    tolerances: float
    worst: tuple[str, float]
    noise: Mapping[str, float] = field(default_factory=dict)
    expected: float = nan

    @property
    def strain(self) -> float:
        """Log-likelihood by which tolerances are further off than they are if all of them are as stated."""
        if not isfinite(self.expected):
            return 0.0
        usual = self.expected + CAL.strained * sqrt(2.0 * self.expected)
        return 0.5 * max(self.tolerances - usual, 0.0)

    def to_json(self) -> dict[str, Any]:
        """Per equation: amplitude beside the share [m/s^2], share of the force, correlation time [s]."""
        return {
            "F_y": {"amplitude": self.floor_y, "share": self.share_y, "correlation_time": self.memory_y},
            "F_x": {"amplitude": self.floor_x, "share": self.share_x, "correlation_time": self.memory_x},
            "tolerances": self.tolerances,
            "expected": self.expected,
            "worst": {"name": self.worst[0], "sd": self.worst[1]},
            "noise": dict(self.noise),
        }


@dataclass(frozen=True)
class Moved:
    """A tolerance that the closed model has elsewhere than stated.

    Attributes
    ----------
    name, unit : the parameter's.
    stated, sd : what is believed of it.
    value : where the closed model has it.
    """

    name: str
    unit: str
    stated: float
    sd: float
    value: float

    @property
    def far(self) -> float:
        """How far it moved, in standard deviations of what is stated."""
        return abs(self.value - self.stated) / self.sd


@dataclass(frozen=True)
class Limit:
    """What would show of an effect that is not there.

    Attributes
    ----------
    size : the least magnitude that would, twice its standard deviation away from nothing; of limits, which act the
        more the lower they are, the largest. Infinite (of limits: zero) where none within the effect's bounds would.
    typical : its usual magnitude.
    unit : of both.
    share : of twice the standard deviation in the usual size: above one the usual size is below the detection limit.
    told : share of what the recordings say of it that stated tolerances do not take up.
    """

    size: float
    typical: float
    unit: str
    share: float
    told: float


@dataclass(frozen=True)
class Gap:
    """What a diagnosis says.

    Attributes
    ----------
    model : name of the model that was diagnosed.
    recordings : names of what it was diagnosed on.
    doubts : sentences on the data, which come before everything else.
    gap_detected, p_value : is there more than noise and stated tolerances; how often noise alone would look so.
    unknown_probability : that there is an unmodelled effect.
    unknown : its shape in a sentence; "" where nothing is unknown.
    where : see `Where`.
    ranking : the effects that may be the cause, most probable first.
    applied : effects that the closed model has.
    classes : of what acts alike, one for each effect of the best explanation, likeliest first.
    gap : how far the gap shrinks on the diagnosed recordings themselves.
    held_out : the same on recordings never used for choosing; None where none were given.
    not_excited : effect -> how small it could be without showing here (twice its standard deviation), with unit.
    absorbed : effects that stated tolerances or free parameters would take up.
    advice : sentences on what could not be told, and the manoeuvre that would tell it.
    closed : the model with the applied effects at their magnitudes.
    strip : for pictures.
    limits : effect that is not applied -> what would show of it, as far as derivatives tell.
    noise_stated : whether sensor noise is; else it is what the best explanation leaves, which proves nothing.
    budget : where the excess error goes; None where no effect was found.
    unnamed : model error that is left; None for models that know no forces.
    resembles : effects that what is unknown looks like if their magnitudes vary all the time, likeliest first.
    moved : tolerances that the closed model has further than one sd from where they are stated, furthest first.
    held : how simulations were kept near readings, in a sentence, where free runs of every explanation spin; "" else.
    tried : effect -> log-likelihood that it was expected to gain by itself, most first; more than `ranking`, which has
        those that were refitted.
    """

    model: str
    recordings: tuple[str, ...]
    doubts: tuple[str, ...]
    gap_detected: bool
    p_value: float
    unknown_probability: float
    unknown: str
    where: Where
    ranking: tuple[Ranked, ...]
    applied: tuple[str, ...]
    gap: Closure
    held_out: Closure | None
    not_excited: Mapping[str, str]
    absorbed: tuple[str, ...]
    advice: tuple[str, ...]
    closed: Diagnosed | None = None
    strip: Strip | None = None
    noise_stated: bool = True
    limits: Mapping[str, Limit] = field(default_factory=dict)
    budget: Budget | None = None
    unnamed: Unnamed | None = None
    resembles: tuple[Wander, ...] = ()
    moved: tuple[Moved, ...] = ()
    tried: Mapping[str, float] = field(default_factory=dict)
    held: str = ""
    classes: tuple[CauseClass, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Everything but the closed model and the picture, as plain data."""
        plain = {item.name: getattr(self, item.name) for item in fields(Gap)}  # results above it hold more
        body = asdict(Gap(**plain | {"closed": None, "strip": None, "budget": None}))
        body["budget"] = [] if self.budget is None else self.budget.to_json()
        body["model_error"] = None if self.unnamed is None else self.unnamed.to_json()
        return {key: value for key, value in body.items() if key not in ("closed", "strip", "unnamed")}
