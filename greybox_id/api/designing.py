"""Design of the next manoeuvre: `gb.design`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from rich.console import RenderableType
from rich.table import Table

from ..base.declared import understood
from ..base.errors import BadInput
from ..base.files import at_once, replacing, write_atomically
from ..base.guard import FileContent, claim, content_of
from ..base.json_data import format_of
from ..base.numbers import alike, pretty_unit
from ..fitting.fit import KIND as FIT_KIND
from ..fitting.fit import Fit
from ..fitting.saved_fit import load
from ..gap.advice import to_distinguish
from ..gap.design.arena import arena as arena_of
from ..gap.design.discriminate import ambiguous, detecting, discriminating
from ..gap.design.limits import must_agree, read_limits, stated, usual_limits
from ..gap.design.plan import KIND, Design
from ..gap.design.precision import CRITERIA, must_move, precise
from ..gap.design.task import LONGEST, MOST_ROWS, SHORTEST, DesignTask
from ..gap.gap import Gap
from ..models.effects import EFFECTS, vocabulary
from ..models.motion_model import MotionModel
from ..models.parameter import Stated
from ..models.registry import build
from ..models.vehicle import Vehicle
from ..models.vehicles import with_tolerances
from ..reports.gap.saved import KIND as GAP_KIND
from ..reports.gap.saved import Made, load_gap
from ..reports.manoeuvre import manoeuvre
from ..reports.text.screen import as_text, plain_table
from . import given
from .gap_result import GapResult
from .given import VehicleLike

GOALS = ("precision", "discriminate", "detect")
FILES = ("design.json", "plan.csv", "plan.svg")
"""Names of the files in a design's folder; the first describes the others."""
KINDS = ("a design", "a table of a manoeuvre", "a figure")
"""Kinds of these files, as named by the guard."""


@dataclass(frozen=True, repr=False)
class DesignResult(Design):
    """Result of `gb.design`: the manoeuvre to drive next.

    Attributes
    ----------
    plan, phases, table() : the manoeuvre: commands per row, the predicted motion and its 95 % corridor.
    sentence : instructions for a driver.
    predicted_sd : name -> standard deviation before and after, in the parameter's unit.
    separation : pairs of explanations, and the log-likelihood that distinguishes them, in nats.
    active_limits, impossible : limits that are reached; sentences on what no manoeuvre can determine.
    """

    @classmethod
    def of(cls, design: Design) -> DesignResult:
        """Wrap a design."""
        return cls(**{one.name: getattr(design, one.name) for one in fields(Design)})

    def save(self, folder: str | Path) -> list[Path]:
        """Write design.json and, if there is a manoeuvre, plan.csv and plan.svg: all or none of them.

        Raises
        ------
        BadInput : if the folder cannot be written.
        """
        place, written = Path(folder), list[Path]()
        with at_once():
            written.append(write_atomically(place / FILES[0], self.text()))
            if self.plan is not None:
                with replacing(place / FILES[1]) as beside:
                    self.table().to_csv(beside, index=False)
                written.append(place / FILES[1])
                written.append(write_atomically(place / FILES[2], manoeuvre(self).svg(self.sentence)))
        if self.plan is None:  # otherwise the plan of an earlier design could be driven by mistake
            for name, kind in zip(FILES[1:], KINDS[1:], strict=True):
                if (place / name).is_file() and content_of(place / name) == FileContent(kind, derived=True):
                    (place / name).unlink()
        return written

    def parts(self) -> Iterator[RenderableType]:
        """The text of the design, part by part."""
        for line in self.said:
            yield line
        if self.plan is not None:
            yield f"drive    {self.sentence}"
            times = f", {self.repeat} times" if self.repeat > 1 else ""
            yield f"         {self.duration:.1f} s{times} in {self.arena.words}; run-up {self.run_up:.0f} m"
            if self.active_limits:
                yield (
                    f"limits   {', '.join(self.active_limits)}: wider limits would make the manoeuvre more informative"
                )
        if self.predicted_sd:
            yield ""
            yield _sd_table(self)
        if self.separation:
            yield ""
            yield _separation_table(self)
        for line in self.impossible:
            yield f"\nimpossible  {line}"

    def summary(self) -> str:
        """The text that `greybox design` prints."""
        return as_text(self.parts())

    def __repr__(self) -> str:
        return f"Design for {self.goal}: {self.sentence or '; '.join((*self.said, *self.impossible))}"


@understood
def design(
    of: Fit | Gap | str | Path,
    goal: str | None = None,
    *,
    arena: str,
    parameters: Sequence[str] = (),
    criterion: str = "d",
    duration: float = 20.0,
    rate: float = 50.0,
    limits: Mapping[str, float] | str | Path | None = None,
    vehicle: VehicleLike = None,
    speed_max: float | None = None,
    grip: float | None = None,
    repeat: int = 1,
    driver: bool = True,
    effort: float = 1.0,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> DesignResult:
    """Design the most informative manoeuvre: for the parameters of a fit, or to separate the explanations of a gap.

    Parameters
    ----------
    of : a fit, or the diagnosis of a gap; or the file of either.
    goal : "precision" of a fit's parameters; "discriminate" between a gap's explanations that its recordings cannot
        distinguish; "detect" effects below the detection limit of its recordings. The default is "precision" for a fit,
        "discriminate" for a gap.
    arena : "straight:120x8", "disc:30" [m], or a .csv file with columns x, y: the outline of a free area.
    parameters : whose precision counts; all free ones by default. With "detect": effects.
    criterion : "d", "a", "e" or "c", see `docs/design.md`.
    duration, rate : longest duration, s, and rows of the plan per second.
    limits : limit -> number in SI units, or a TOML file of such entries; the others are derived from the vehicle's
        size.
    vehicle : its file states the steering range (`steer_max`), unless `limits` do.
    speed_max, grip : m/s; largest share of an axle's friction that is used.
    repeat : how often the manoeuvre is going to be driven.
    driver : whether a driver controls speed and path (`greybox_id.gap.design.driver`), or commands are applied open
        loop.
    effort : of the search, relative to the usual one: 0.2 is quick, 3 is almost exhaustive.
    seed : of random numbers.
    progress : called with each line of progress.

    Returns
    -------
    DesignResult
        `sentence`, `table()`, `predicted_sd`, `separation`, `impossible`, `save(folder)`, `summary()`.

    Raises
    ------
    BadInput : if the model cannot predict a manoeuvre, the arena is too small, the limits contradict each other, or a
        name is unknown.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> fit = gb.fit("single_track", lap, vehicle="roboracer")
    >>> limits = {"speed_max": 4.0, "sideslip_max": 0.4}
    >>> design = gb.design(fit, arena="disc:12", parameters=["I_z"], duration=6.0, limits=limits, effort=0.05)
    >>> before, after = design.predicted_sd["I_z"]
    >>> after < before
    True
    """
    say = progress or (lambda line: None)
    source, made = _source(of)
    chosen = _goal(source, goal)
    if criterion not in CRITERIA:
        raise BadInput(f"‹criterion›: there is no {criterion!r:.40}; choose one of {', '.join(CRITERIA)}.")
    _must_be_possible(duration, rate, repeat, effort)
    where = arena_of(str(arena))
    if isinstance(source, Fit):
        model = must_move(source.model)
    else:
        assert made is not None
        model = nominal_of(source, made)
    allowed = usual_limits(model, (where.length, where.breadth))
    file = "" if limits is None or isinstance(limits, Mapping) else f" {limits}"
    read = {} if limits is None else dict(limits) if isinstance(limits, Mapping) else read_limits(limits)
    more: dict[str, object] = {}
    car = given.vehicle(vehicle)
    for name, part in (
        ("vehicle›", {} if car is None or car.steer_max is None else {"steer_max": car.steer_max}),
        (f"limits›{file}", read),
        ("speed_max›", {} if speed_max is None else {"speed_max": speed_max}),
        ("grip›", {} if grip is None else {"grip": grip}),
    ):
        stated(allowed, part, f"‹{name}")  # the message names the source of the error
        more |= part
    allowed = must_agree(stated(allowed, more, "‹limits›"))
    design_task = DesignTask(
        where, allowed, float(duration), float(rate), int(repeat), int(seed), driver, float(effort)
    )
    if isinstance(source, Fit):
        result = precise(source, parameters, criterion, design_task, say)
    elif chosen == "discriminate":
        result = discriminating(source, model, vocabulary(), design_task, say)
    else:
        result = detecting(source, model, vocabulary(), parameters, design_task, say)
    return DesignResult.of(result)


def _goal(source: Fit | Gap, goal: str | None) -> str:
    """The goal of the design. Raises `BadInput` if it does not suit a fit or a gap."""
    chosen = goal or ("precision" if isinstance(source, Fit) else "discriminate")
    if chosen not in GOALS:
        raise BadInput(f"‹goal›: there is no {chosen!r:.40}; choose one of {', '.join(GOALS)}.")
    if isinstance(source, Fit) != (chosen == "precision"):
        needs, is_one = ("a fit", "a gap") if chosen == "precision" else ("a gap (gap.json of greybox gap)", "a fit")
        raise BadInput(f"‹goal› {chosen} needs {needs}, but {is_one} was given. Name the other file or another ‹goal›.")
    return chosen


def _must_be_possible(duration: float, rate: float, repeat: int, effort: float) -> None:
    """Raise `BadInput` for numbers out of range."""
    for name, value, low, high in (
        ("duration", duration, SHORTEST, LONGEST), ("rate", rate, 5.0, 1000.0), ("repeat", repeat, 1, 100),
        ("effort", effort, 0.01, 20.0),
    ):  # fmt: skip
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise BadInput(f"‹{name}› {value!r:.40} must be a number between {low:g} and {high:g}.")
    if duration * rate > MOST_ROWS:
        raise BadInput(
            f"‹duration› {duration:g} s at ‹rate› {rate:g} Hz are more than {MOST_ROWS} rows; lower one of them."
        )


def quoted(gap: GapResult, arena: str, progress: Callable[[str], None] | None = None) -> GapResult:
    """A diagnosis that advises the manoeuvre designed for an arena, if explanations cannot be distinguished."""
    names = ambiguous(gap)
    if not names:
        return gap
    lead = to_distinguish(names)
    try:
        design_result = design(gap, "discriminate", arena=arena, progress=progress)
    except BadInput as error:  # keep the diagnosis anyway
        advice: tuple[str, ...] = (f"{lead}: {error}",)
    else:
        expected = "; ".join(f"{' or '.join(item.pair)} by {item.nats:.0f} nats" for item in design_result.separation)
        way = f"{design_result.sentence[:1].lower()}{design_result.sentence[1:]}"
        where = f"In {design_result.arena.words}, {design_result.duration:.1f} s"
        drive = f"{lead}, drive {way} {where} of driving are expected to distinguish {expected}."
        advice = (*((drive,) if design_result.phases else ()), *design_result.impossible)
    alike = [(item.effect, *item.indistinguishable_from) for item in gap.ranking if item.indistinguishable_from]
    instead = tuple(f"{to_distinguish(item)}: " for item in alike if set(names) <= {*item})
    return replace(gap, advice=(*advice, *(line for line in gap.advice if not line.startswith(instead))))


def targets(folder: str | Path) -> Path:
    """The folder of a design; its files are claimed before the computation."""
    place = Path(folder)
    for name, kind in zip(FILES, KINDS, strict=True):
        claim(place / name, "‹out›", kind)
    return place


def nominal_of(gap: Gap, made: Made) -> MotionModel:
    """The diagnosed model with the stated numbers of its vehicle, as saved with the diagnosis."""
    values = {n.name: Stated(n.value, n.sd, source=n.source) for n in made.stated if n.value is not None}
    tolerances = {
        n.name: Stated(n.value, n.sd, source=n.source) for n in made.stated if n.name in EFFECTS and n.sd is not None
    }
    vehicle = Vehicle(made.vehicle, {k: v for k, v in values.items() if k not in EFFECTS}, effects=tolerances)
    model = build(gap.model, dict(made.settings), dict(made.effects), vehicle=vehicle)
    return with_tolerances(must_move(model, "Diagnose"), vehicle, EFFECTS)


def _source(of: Fit | Gap | str | Path) -> tuple[Fit | Gap, Made | None]:
    """The fit or gap to design for, read from its file if necessary."""
    if isinstance(of, GapResult):
        return of, of.made
    if isinstance(of, Fit):
        return of, None
    if not isinstance(of, str | Path):
        raise BadInput(f"of: a fit, a gap or the path of its file is needed, not {of!r:.60}.")
    kind = format_of(of)
    if kind == GAP_KIND.format:
        return load_gap(of)
    if kind not in (FIT_KIND.format, ""):
        raise BadInput(
            f"{of} is {kind}, neither a fit nor a gap: name the fit.json of greybox fit or gap.json of greybox gap."
        )
    return load(of, build), None


def _sd_table(design: Design) -> Table:
    table = plain_table("parameter", "sd now", "sd with it", "unit")
    units = {parameter.name: parameter.unit for parameter in build(design.model).parameters}
    units |= {name: effect.parameter.unit for name, effect in EFFECTS.items()}
    for name, (before, after) in design.predicted_sd.items():
        table.add_row(name, *alike(before, after, by=after), pretty_unit(units.get(name, "")))
    return table


def _separation_table(design: Design) -> Table:
    table = plain_table("explanations", "nats", "at least (90 %)")
    for one in design.separation:
        table.add_row(" or ".join(one.pair), f"{one.nats:.1f}", f"{one.p10:.1f}")
    return table


def as_dict(design: Design, written: Sequence[Path] = ()) -> dict[str, Any]:
    """The object that `greybox design --json` prints."""
    return design.as_dict() | {"written": [str(path) for path in written]}


__all__ = ["KIND", "DesignResult", "as_dict", "design", "quoted", "targets"]
