"""Diagnosis of the gap between a simulation and the vehicle."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ..base.declared import understood
from ..base.errors import BadInput
from ..base.version import __version__
from ..datasets.checks.finding import listed
from ..datasets.recording import Recording, held_twice
from ..engine.simulation import Diagnosed, equations_of_motion
from ..fitting.fit import Fit
from ..fitting.holding import as_fitted
from ..fitting.provenance import data_record
from ..fitting.requested_model import doubts, must_be_recorded
from ..gap.changes.verb import Visible, diagnose_change, visible_changes
from ..gap.diagnosis import diagnose as diagnose_gap
from ..gap.estimation.memory_bench import must_suit
from ..gap.gap import Gap
from ..models.effect import Effect
from ..models.effects import vocabulary
from ..models.memory_model import MemoryModel
from ..models.model import Model
from ..models.motion_model import MotionModel
from ..models.registry import install, known, model_of
from ..models.vehicle import Vehicle
from ..reports.gap.saved import Made, stated_numbers
from . import given
from .closed_vehicle import FITTED, fitted_vehicle, with_sensors
from .fitting import Progress
from .gap_result import ChangeResult, GapResult
from .given import Columns, ModelLike, Recordings, VehicleLike


@understood
def diagnose(
    model: ModelLike | Fit | Vehicle,
    after: Recordings,
    since: Recordings | None = None,
    *,
    held_out: Recordings = (),
    vehicle: VehicleLike = None,
    effects: Mapping[str, Effect] | Iterable[Effect | str] | None = None,
    columns: Columns = "canonical",
    seed: int = 0,
    horizons: bool = False,
    progress: Progress | None = None,
) -> GapResult:
    """Diagnose where a simulation deviates from the vehicle, by which effects, and how far these close the gap.

    Parameters
    ----------
    model : the simulation: a fit (its estimates with their standard errors), a model, a model's name, or a vehicle,
        whose model is used.
    after : recordings of the vehicle: one or a list, as recordings or files.
    since : recordings from before a possible change; the diagnosis is then of what changed since.
    held_out : recordings with no influence on the choice of effects, on which the closure is verified.
    vehicle : stated numbers: tolerances, within which parameters are refitted at a cost, and sensor noise. For a model
        given by name, also its initial values; a fit has its own, and uses only noise, model error and effects with
        tolerances.
    effects : what the model may lack; by default all known effects, shipped and from installed packages. Your own
        effects can be given in a list of `Effect` and names, or all effects by name, as a mapping.
    columns : column map for files.
    seed : of random numbers.
    horizons : whether to compute errors over fixed horizons on the diagnosed recordings, too.
    progress : called with each line of progress.

    Returns
    -------
    Gap
        `ranking`, `closed_model`, `plot()`, `summary()`, `to_pandas()`; with `since` also `changed`, `not_changed`,
        `not_seen` and `scatter`.

    Raises
    ------
    BadInput : if a recording lacks an input of the model, is both diagnosed and held out, or no effect acts on the
        model; with `since`, if the model is not one of motion, or no vehicle is stated.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 200)
    >>> fit = gb.fit("kinematic", lap, vehicle="roboracer")
    >>> gap = gb.diagnose(fit, lap, effects=["steering_delay", "steering_lag"])
    >>> isinstance(gap, gb.Gap)
    True
    """
    install()
    nominal, stated = nominal_model(model, vehicle)
    recordings = given.recordings(after, columns, "after")
    others = (
        [] if isinstance(held_out, list | tuple) and not held_out else given.recordings(held_out, columns, "held_out")
    )
    before = None if since is None else given.recordings(since, columns, "since")
    if isinstance(model, Fit):
        recordings, others = ([as_fitted(model, one) for one in several] for several in (recordings, others))
        before = None if before is None else [as_fitted(model, one) for one in before]
    everything = [*recordings, *others, *(before or ())]
    must_be_diagnosable(nominal, everything)
    if twice := held_twice(recordings, others):
        raise BadInput(
            f"‹held_out›: {twice[0]} holds the same data as {twice[1]}, which is diagnosed. Hold out another recording."
        )
    tried = _candidates(effects)
    if before is not None:
        with known(nominal, *tried.values()):
            changed = diagnose_change(nominal, recordings, before, tried, vehicle=stated, held_out=others, say=progress)
        doubted_change = replace(changed, gap=doubted(changed.gap, nominal, stated, recordings))
        made = made_with(nominal, changed.vehicle, recordings, others, seed)
        return ChangeResult.since_then(doubted_change, made, changed.vehicle)
    with known(nominal, *tried.values()):
        result = diagnose_gap(
            nominal,
            recordings,
            tried,
            vehicle=stated,
            held_out=others,
            say=progress,
            seed=seed,
            horizons=horizons,
        )
    made = made_with(nominal, stated, recordings, others, seed)
    return GapResult.of(doubted(result, nominal, stated, recordings), made, stated)


def visible(
    model: ModelLike | Fit | Vehicle,
    since: Recordings,
    *,
    vehicle: VehicleLike = None,
    columns: Columns = "canonical",
    progress: Progress | None = None,
) -> tuple[Visible, ...]:
    """Smallest changes that would be detected on one more recording like those from before.

    Parameters and errors are those of `diagnose`.
    """
    install()
    nominal, stated = nominal_model(model, vehicle)
    before = given.recordings(since, columns, "since")
    must_be_diagnosable(nominal, before)
    return visible_changes(nominal, before, vocabulary(), vehicle=stated, say=progress)


def must_be_diagnosable(nominal: Diagnosed, recordings: Sequence[Recording]) -> None:
    """Raise `BadInput` if a recording lacks an input of the model, or all of its outputs."""
    must_be_recorded(nominal, recordings)
    if isinstance(nominal, MemoryModel):
        must_suit(nominal, recordings)
    for recording in recordings:
        if not any(name in recording for name in nominal.outputs):
            raise BadInput(
                f"{recording.name} has none of {', '.join(nominal.outputs)}, which {nominal.name} predicts; name "
                "the column of at least one of these in the column map (‹columns›)."
            )


def doubted(gap: Gap, nominal: Diagnosed, stated: Vehicle | None, recordings: Sequence[Recording]) -> Gap:
    """The diagnosis, with doubts whether the vehicle is the recorded one, and advice on effects that a fit absorbs."""
    more = doubts(nominal, stated, recordings) if stated is not None else []
    gap = replace(gap, doubts=(*gap.doubts, *(doubt for doubt in more if doubt not in gap.doubts)))
    of_a_fit = stated is not None and any(number.source == FITTED for number in stated.values.values())
    if gap.applied or not gap.absorbed or not of_a_fit:
        return gap
    since = (
        f"{listed([*gap.absorbed])} cannot be detected here: uncertain parameters of the fit have the same influence. "
        "To "
        "see "
        "what has changed, diagnose with recordings from before the change."
    )
    return replace(gap, advice=(*gap.advice, since))


def made_with(
    nominal: Diagnosed,
    stated: Vehicle | None,
    recordings: Sequence[Recording],
    others: Sequence[Recording],
    seed: int,
) -> Made:
    """Provenance of a diagnosis, for its report."""
    return Made(
        vehicle=stated.name if stated is not None else nominal.name,
        command="",
        seed=seed,
        version=__version__,
        data=(*(data_record(one, "train") for one in recordings), *(data_record(one, "validate") for one in others)),
        settings=dict(nominal.settings),
        effects={name: float(nominal[name].array) for name in nominal.effects},
        stated=stated_numbers(stated, nominal) if stated is not None else (),
    )


def of_fit(fit: Fit, name: str, stated: Vehicle | None = None) -> tuple[Diagnosed, Vehicle]:
    """The model of a fit, and the vehicle from its estimates under a name, with the sensors of a stated vehicle.

    Raises as `must_have_gaps`, and `BadInput` if a vehicle is given for a model that contains a network.
    """
    model = must_have_gaps(fit.model)
    if stated is not None and model.learnt:
        raise BadInput(
            f"{model.name} is {fit.model.called}, whose noise is known from its training: it needs no vehicle. Omit "
            f"{stated.name} (‹vehicle›)."
        )
    with known(model):
        fitted = fitted_vehicle(fit, name)
    return model, fitted if stated is None else with_sensors(fitted, stated)


def must_have_gaps(model: Model) -> Diagnosed:
    """The model that is diagnosed: a hybrid becomes equations of motion with constant weights.

    Raises
    ------
    BadInput : if that is not possible, since its network has a memory or predicts steps instead of derivatives.
    """
    if isinstance(model, MemoryModel):
        return model
    return equations_of_motion(model, "; a gap can be diagnosed for these and for models with memory")


def must_be_stated(model: Model) -> Model:
    """The model, if a vehicle can state its parameters. Raises `BadInput` for models with memory and hybrids."""
    if not isinstance(model, MotionModel):
        raise BadInput(
            f"{model.name} is {model.called}, and no vehicle file holds its weights. Fit it and name the fit "
            "(‹fit›), or name equations of motion (‹model›): single_track or lateral."
        )
    return model


def nominal_model(model: ModelLike | Fit | Vehicle, vehicle: VehicleLike = None) -> tuple[Diagnosed, Vehicle | None]:
    """The model to diagnose and its stated vehicle. Parameters and errors are those of `diagnose`."""
    stated = model if isinstance(model, Vehicle) else given.vehicle(vehicle)
    if isinstance(model, Fit):
        file = getattr(model, "file", None)
        return of_fit(model, model.model.name if file is None else str(file), stated)
    result = model_of(model) if isinstance(model, Vehicle) else given.model(model, stated)
    return must_have_gaps(must_be_stated(result)), stated


def _candidates(effects: Mapping[str, Effect] | Iterable[Effect | str] | None) -> dict[str, Effect]:
    """Effects that the model may lack, by name."""
    if effects is None:
        return vocabulary()
    if isinstance(effects, Mapping):
        result = dict(effects)
        for name, effect in result.items():
            if not isinstance(effect, Effect):
                raise BadInput(f"effects: {name} is no Effect but {effect!r:.60}.")
        return result
    if isinstance(effects, str | Path):
        raise BadInput(f"effects: a list is needed, as in effects=[{str(effects)!r}], not the text {str(effects)!r}.")
    result = {}
    for effect in effects:
        if isinstance(effect, Effect):
            result[effect.name] = effect
        else:
            result[effect] = given.effect(effect)
    return result
