"""The answer of a diagnosis: where a simulation deviates, which effect causes it, how far the gap shrinks with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from math import isfinite, nan, sqrt
from typing import Any

from ..engine.simulation import Diagnosed
from ..fitting.scores.horizons import Errors
from .estimation.calibration import CAL
from .estimation.strip import Strip
from .estimation.varying import MagnitudeCourse
from .estimation.wandering import Wander


@dataclass(frozen=True)
class Where:
    """Where a gap lies.

    Attributes
    ----------
    channel : the channel that deviates most; "" where there is no gap.
    regime : the regime that holds more than its share of the gap, one of `regimes.regimes`; "any" where none does.
    equations : part of the equations ("steering", "F_y", "sensors" ...) -> its share of the log-likelihood to be
        gained.
    time : "from", "to" [s]: the shortest stretch that holds half of the gap; "share": of the recording's duration.
        Where recordings' times start anew, runs are put one after the other.
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
    indistinguishable_from : effects that this recording cannot distinguish from it.
    gain : of the log-likelihood over the model without it, beside the other applied effects.
    reason : why it is not applied although it is part of the best explanation, or certain; "" otherwise.
    since, until : s, in the time of `within`, where it begins or ends there; None where it acts from the start, or to
        the end.
    within : name of the recording, and of its run if it has several, in which it begins or ends; "" where it acts
        everywhere.
    others : its second parameters that differ from their usual values, by name: the direction of wind.
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
        """Whether it acts at the end of the recordings, and so is part of the vehicle afterwards."""
        return self.until is None


@dataclass(frozen=True)
class CauseClass:
    """Effects that act alike on these recordings, one of which is present.

    Which act alike follows from the recordings: each member, in the place of the first and everything else refitted,
    explains them as well.

    Attributes
    ----------
    members : likeliest first.
    probability : that one of them is present.
    each : member -> probability that it is the one.
    applied : the member in the closed model; "" where there is none.
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
    before, after, floor : mean square of the errors over that of the noise, with equal weight for all channels; the
        floor is one, or less where errors are less.
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
        """Whether the gap in free run, tolerances refitted, is large enough for shares of it to be meaningful."""
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
    """Which share of the excess error each effect closes.

    Attributes
    ----------
    shares : of the applied effects, in their order.
    unnamed : the share that no effect closes; its name is "unexplained".
    recordings : on which it was measured.
    held_out : whether these chose nothing.
    shows : whether the excess is large enough for shares to be meaningful.
    beside : of each effect, which share it closes of the excess that all others leave.
    together : held out, how far all effects together close the gap, from the same refits, so that a report agrees with
        itself.
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
        """The share by which an effect is judged: of the excess that all others leave, as some causes are small.

        Its share of the whole where the others are not known to be causes: for a single effect both are the same.
        """
        return next((share for share in self.beside if share.effect == effect), self.of(effect))

    def to_json(self) -> list[dict[str, Any]]:
        """One object per effect, and one for the unexplained rest."""
        rest = {"unnamed": self.unnamed.share, "low": self.unnamed.low, "high": self.unnamed.high}
        return [*(asdict(share) for share in self.shares), rest]


@dataclass(frozen=True)
class Unnamed:
    """Remaining model error beside the best explanation, with the strain of nuisances and the noise.

    Attributes
    ----------
    share_y, share_x : standard deviation of unknown lateral and longitudinal forces, over the forces themselves.
    floor_y, floor_x : standard deviation of the unknown forces in addition to that, over the mass, m/s^2.
    memory_y, memory_x : their correlation times, s.
    tolerances : cost of nuisances, twice their negative log prior; chi-square about `expected` where everything is as
        stated.
    worst : the nuisance that is furthest from its mean, and by how many standard deviations.
    noise : channel -> noise over its stated size.
    expected : how many nuisances the recordings determine; NaN in files of earlier versions.
    sizes : root mean squares of the unknown lateral and longitudinal forces over those of the modelled ones; likewise.
    over_usual : root mean square of the force that is largest compared with its usual size, over that; likewise.
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
    sizes: tuple[float, float] = (nan, nan)
    over_usual: float = nan

    @property
    def strain(self) -> float:
        """Log-likelihood by which tolerances deviate more than they would if all were as stated."""
        if not isfinite(self.expected):
            return 0.0
        usual = self.expected + CAL.strained * sqrt(2.0 * self.expected)
        return 0.5 * max(self.tolerances - usual, 0.0)

    def to_json(self) -> dict[str, Any]:
        """Per equation: amplitude beside the share [m/s^2], share of the force, correlation time [s], size of both."""
        kinds = ("amplitude", "share", "correlation_time", "size")
        lateral, longitudinal = self.sizes
        return {
            "F_y": dict(zip(kinds, (self.floor_y, self.share_y, self.memory_y, lateral), strict=True)),
            "F_x": dict(zip(kinds, (self.floor_x, self.share_x, self.memory_x, longitudinal), strict=True)),
            "over_usual": self.over_usual,
            "tolerances": self.tolerances,
            "expected": self.expected,
            "worst": {"name": self.worst[0], "sd": self.worst[1]},
            "noise": dict(self.noise),
        }


@dataclass(frozen=True)
class Moved:
    """A parameter with a tolerance whose value in the closed model differs from the stated one.

    Attributes
    ----------
    name, unit : the parameter's.
    stated, sd : its stated value and tolerance.
    value : in the closed model.
    """

    name: str
    unit: str
    stated: float
    sd: float
    value: float

    @property
    def far(self) -> float:
        """Distance from the stated value, in its standard deviations."""
        return abs(self.value - self.stated) / self.sd


@dataclass(frozen=True)
class Limit:
    """Detection limit of an effect that is not present.

    Attributes
    ----------
    size : the least magnitude that would be detected, twice its standard deviation; of limits, which act the more the
        lower they are, the largest. Infinite (of limits: zero) where none within the effect's bounds would be.
    typical : its usual magnitude.
    unit : of both.
    share : of twice the standard deviation in the usual size: above one the usual size is below the detection limit.
    told : share of the recordings' information about it that stated tolerances do not absorb.
    """

    size: float
    typical: float
    unit: str
    share: float
    told: float


@dataclass(frozen=True)
class Gap:
    """The answer of a diagnosis.

    Attributes
    ----------
    model : name of the model that was diagnosed.
    recordings : names of those it was diagnosed on.
    doubts : sentences on the data, which come before everything else.
    gap_detected, p_value : whether there is more than noise and stated tolerances; how often noise alone would look so.
    unknown_probability : that there is an unmodelled effect.
    unknown : its shape in a sentence; "" where nothing is unknown.
    where : see `Where`.
    ranking : the effects that may be the cause, most probable first.
    applied : effects that the closed model has.
    classes : of effects that act alike, one for each effect of the best explanation, likeliest first.
    gap : how far the gap shrinks on the diagnosed recordings themselves.
    held_out : the same on recordings never used for choosing; None where none were given.
    not_excited : effect -> how small it could be without being detected (twice its standard deviation), with unit.
    absorbed : effects that stated tolerances or free parameters would absorb.
    advice : sentences on what could not be distinguished, and the manoeuvre that would do so.
    closed : the model with the applied effects at their magnitudes.
    strip : data of pictures.
    limits : effect that is not applied -> its detection limit, as far as derivatives give it.
    noise_stated : whether sensor noise is; else it is the error that the best explanation leaves, which proves nothing.
    budget : shares of the excess error; None where no effect was found.
    unnamed : remaining model error; None for models without unknown forces.
    resembles : effects whose magnitudes, if they varied all the time, would produce the unknown part, likeliest first.
    courses : of the first of these, along the path or over time, if free runs with it surely err less.
    moved : tolerances that differ in the closed model by more than one sd from their stated values, furthest first.
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
    courses: tuple[MagnitudeCourse, ...] = ()
    moved: tuple[Moved, ...] = ()
    tried: Mapping[str, float] = field(default_factory=dict)
    held: str = ""
    classes: tuple[CauseClass, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Everything but the closed model and the picture, as plain data."""
        plain = {item.name: getattr(self, item.name) for item in fields(Gap)}  # without the fields of subclasses
        body = asdict(Gap(**plain | {"closed": None, "strip": None, "budget": None}))
        body["budget"] = [] if self.budget is None else self.budget.to_json()
        body["courses"] = [each.to_json() for each in self.courses]
        body["model_error"] = None if self.unnamed is None else self.unnamed.to_json()
        return {key: value for key, value in body.items() if key not in ("closed", "strip", "unnamed")}
