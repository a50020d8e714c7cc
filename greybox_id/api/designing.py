"""Designing the manoeuvre to be driven next: `gb.design`."""

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
"""Names of the files in the folder of a design; the one that describes the others first."""
KINDS = ("a design", "a table of a manoeuvre", "a figure")
"""What the guard calls them."""


@dataclass(frozen=True, repr=False)
class DesignResult(Design):
    """The manoeuvre to be driven next: `gb.design` returns it.

    Attributes
    ----------
    plan, phases, table() : what is driven: commands row by row, what it leads to and the 95 % corridor.
    sentence : what a driver is told.
    predicted_sd : name -> standard deviation before and after, in the parameter's unit.
    separation : pairs of explanations and the log-likelihood that tells them apart, in nats.
    active_limits, impossible : limits it uses up; sentences on what no manoeuvre tells.
    """

    @classmethod
    def of(cls, design: Design) -> DesignResult:
        """A design with what can be done with it."""
        return cls(**{one.name: getattr(design, one.name) for one in fields(Design)})

    def save(self, folder: str | Path) -> list[Path]:
        """Write design.json and, where there is something to drive, plan.csv and plan.svg: all or none of them.

        Raises
        ------
        BadInput : the folder cannot be written.
        """
        place, written = Path(folder), list[Path]()
        with at_once():
            written.append(write_atomically(place / FILES[0], self.text()))
            if self.plan is not None:
                with replacing(place / FILES[1]) as beside:
                    self.table().to_csv(beside, index=False)
                written.append(place / FILES[1])
                written.append(write_atomically(place / FILES[2], manoeuvre(self).svg(self.sentence)))
        if self.plan is None:  # a plan of an earlier design beside a file that says there is none would be driven
            for name, kind in zip(FILES[1:], KINDS[1:], strict=True):
                if (place / name).is_file() and content_of(place / name) == FileContent(kind, derived=True):
                    (place / name).unlink()
        return written

    def parts(self) -> Iterator[RenderableType]:
        """What it says, part by part."""
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
        """What `greybox design` prints."""
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
    """Design the most informative manoeuvre: for a fit's parameters, or to separate the explanations of a gap.

    Parameters
    ----------
    of : a fit, or the diagnosis of a gap; or the file of either.
    goal : "precision" of a fit's parameters; "discriminate", of a gap's explanations that its recordings cannot tell
        apart; "detect", effects that its recordings could not show. Usual: "precision" of a fit, "discriminate" of a
        gap.
    arena : "straight:120x8", "disc:30" [m], or a .csv file with columns x, y: the outline of a free area.
    parameters : whose precision counts; all free ones unless any is named. With "detect": effects.
    criterion : "d", "a", "e" or "c", see `docs/design.md`.
    duration, rate : s at most, rows of the plan a second.
    limits : limit -> number in SI units, or a TOML file of such lines; others follow from the vehicle's size.
    vehicle : whose file states where the steering stops (`steer_max`), unless `limits` do.
    speed_max, grip : m/s; largest share of an axle's friction that is used.
    repeat : how often it is going to be driven.
    driver : whether speed and path are kept by a driver (`greybox_id.gap.design.driver`), or commands given as they
        stand.
    effort : of the search, over what is usual: 0.2 is quick, 3 leaves little to be found.
    seed : of everything random.
    progress : called with one line at a time.

    Returns
    -------
    DesignResult
        `sentence`, `table()`, `predicted_sd`, `separation`, `impossible`, `save(folder)`, `summary()`.

    Raises
    ------
    BadInput : the model cannot say what a manoeuvre leads to, the arena is too small or the limits contradict each
        other, or a name stands for nothing.

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
    entry = usual_limits(model, (where.length, where.breadth))
    file = "" if limits is None or isinstance(limits, Mapping) else f" {limits}"
    read = {} if limits is None else dict(limits) if isinstance(limits, Mapping) else read_limits(limits)
    more: dict[str, object] = {}
    known = given.vehicle(vehicle)
    for name, part in (
        ("vehicle›", {} if known is None or known.steer_max is None else {"steer_max": known.steer_max}),
        (f"limits›{file}", read),
        ("speed_max›", {} if speed_max is None else {"speed_max": speed_max}),
        ("grip›", {} if grip is None else {"grip": grip}),
    ):
        stated(entry, part, f"‹{name}")  # says which of them is at fault
        more |= part
    entry = must_agree(stated(entry, more, "‹limits›"))
    design_task = DesignTask(where, entry, float(duration), float(rate), int(repeat), int(seed), driver, float(effort))
    if isinstance(source, Fit):
        result = precise(source, parameters, criterion, design_task, say)
    elif chosen == "discriminate":
        result = discriminating(source, model, vocabulary(), design_task, say)
    else:
        result = detecting(source, model, vocabulary(), parameters, design_task, say)
    return DesignResult.of(result)


def _goal(source: Fit | Gap, goal: str | None) -> str:
    """What is designed for. Raises `BadInput` where a fit or a gap does not go with it."""
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
    """A diagnosis whose advice is the manoeuvre that is computed for an arena, where explanations are open."""
    names = ambiguous(gap)
    if not names:
        return gap
    lead = to_distinguish(names)
    try:
        design_result = design(gap, "discriminate", arena=arena, progress=progress)
    except BadInput as error:  # the diagnosis is worth having all the same
        known: tuple[str, ...] = (f"{lead}: {error}",)
    else:
        expected = "; ".join(f"{' or '.join(item.pair)} by {item.nats:.0f} nats" for item in design_result.separation)
        way = f"{design_result.sentence[:1].lower()}{design_result.sentence[1:]}"
        where = f"In {design_result.arena.words}, {design_result.duration:.1f} s"
        drive = f"{lead}, drive {way} {where} of driving are expected to distinguish {expected}."
        known = (*((drive,) if design_result.phases else ()), *design_result.impossible)
    alike = [(item.effect, *item.indistinguishable_from) for item in gap.ranking if item.indistinguishable_from]
    instead = tuple(f"{to_distinguish(item)}: " for item in alike if set(names) <= {*item})
    return replace(gap, advice=(*known, *(line for line in gap.advice if not line.startswith(instead))))


def targets(folder: str | Path) -> Path:
    """The folder of a design, its files claimed before long work."""
    place = Path(folder)
    for name, kind in zip(FILES, KINDS, strict=True):
        claim(place / name, "‹out›", kind)
    return place


def nominal_of(gap: Gap, made: Made) -> MotionModel:
    """The model that was diagnosed, with what was stated of its vehicle, as the file of the diagnosis has it."""
    values = {n.name: Stated(n.value, n.sd, source=n.source) for n in made.stated if n.value is not None}
    tolerances = {
        n.name: Stated(n.value, n.sd, source=n.source) for n in made.stated if n.name in EFFECTS and n.sd is not None
    }
    vehicle = Vehicle(made.vehicle, {k: v for k, v in values.items() if k not in EFFECTS}, effects=tolerances)
    model = build(gap.model, dict(made.settings), dict(made.effects), vehicle=vehicle)
    return with_tolerances(must_move(model, "Diagnose"), vehicle, EFFECTS)


def _source(of: Fit | Gap | str | Path) -> tuple[Fit | Gap, Made | None]:
    """What a manoeuvre is designed for: a fit or a gap, read where a file is named."""
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
    """What `greybox design --json` prints."""
    return design.as_dict() | {"written": [str(path) for path in written]}


__all__ = ["KIND", "DesignResult", "as_dict", "design", "quoted", "targets"]
