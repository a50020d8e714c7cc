"""Fitting a model to recordings, and fits from files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..base.declared import understood
from ..base.errors import BadInput
from ..datasets.recording import Recording, join
from ..fitting.fit import Fit
from ..fitting.how import FitOptions, Say, quiet
from ..fitting.posterior.posterior import Posterior
from ..fitting.pretraining import Pretraining, Span
from ..fitting.requested_model import RequestedModel, doubts, must_be_recorded, with_choices
from ..fitting.saved_fit import load as load_fit
from ..fitting.scores.metrics import must_suit
from ..fitting.scores.misfit import must_tell
from ..fitting.training import TrainedBefore
from ..fitting.verb import fit as fit_model
from ..models.effect import Effect
from ..models.model import Model, by_kind
from ..models.registry import build, install, known, own_effect, own_model
from ..models.vehicle import Vehicle
from . import given
from .fit_result import FitResult
from .given import Columns, Effects, ModelLike, Numbers, Recordings, VehicleLike

Progress = Callable[..., None]
"""Called with a line of progress at a time."""


@understood
def fit(
    model: ModelLike | Vehicle | None,
    recordings: Recordings,
    *,
    validation: Recording | str | Path | None = None,
    vehicle: VehicleLike = None,
    settings: Mapping[str, Any] | None = None,
    effects: Effects = (),
    fix: str | Iterable[str] | Numbers = (),
    free: str | Iterable[str] = (),
    prior: Numbers | None = None,
    start: Numbers | None = None,
    per_run: str | Iterable[str] = (),
    columns: Columns = "canonical",
    options: FitOptions | None = None,
    pretrain: Fit | Posterior | str | Path | None = None,
    pretrain_points: int = 20_000,
    pretrain_range: Span = "data",
    pretrain_beyond: float = 1.0,
    progress: Progress | None = None,
) -> FitResult:
    """Fit a model to recordings.

    Parameters
    ----------
    model : a model (`gb.models`, or one's own), its name, or "my_car.py:my_model"; None, or a vehicle, takes the
        vehicle's model. Its nominal values are the start.
    recordings : training data: one recording or a list, read or named by files; a name may be a pattern.
    validation : a recording that is only scored, except under early stopping, where it chooses when to stop.
    vehicle : whose numbers a model that is named starts from: a `Vehicle`, a shipped name or a file.
    settings : hyperparameters of a model that is named, such as {"tyre": "brush"}.
    effects : names of effects that are added, "steering_delay" (estimated) or "steering_delay=30ms" (fixed).
    fix : parameters that are held, by name; or name -> value to hold them at, a number in SI or a text with a unit.
    free : names of parameters that are estimated though the model fixes them.
    prior : name -> (mean, sd), estimated with that prior.
    start : name -> value where the estimation starts.
    per_run : names of parameters that have one value for each unbroken run.
    columns : column map, where files are named.
    options : horizon, starting points, solver, seed.
    pretrain : for mlp_lateral and bicycle_mlp, a fit or posterior of equations of motion, or its file, from which the
        network learns first; bicycle_mlp takes its physics from there. For hybrid_stiffness and hybrid_force, a fit of
        the same model, whose training is carried on: of a vehicle with other tyres, 20 s will do.
    pretrain_points, pretrain_range : at how many points, on rows of the recordings ("data") or in a box 1.3 times as
        wide ("box").
    pretrain_beyond : for speeds that were not driven: train also on what the known vehicle does at up to so many times
        the fastest speed recorded, from 1 to 3.
    progress : called with one line at a time.

    Returns
    -------
    Fit
        Estimates with intervals (`params`, `stderr`, `conf_int()`), `summary()`, `score(...)`, `plot`, and more. Ctrl-C
        keeps the best point so far and says so in the stage's status.

    Raises
    ------
    BadInput : a name stands for nothing, a recording lacks a signal, differs in sample time or is too short, or nothing
        moves in any.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> fit = gb.fit("kinematic", lap, vehicle="roboracer", fix={"l_f": "16 cm"})
    >>> float(fit.params["l_f"])
    0.16
    """
    how = options if options is not None else FitOptions()
    if not isinstance(how, FitOptions):
        raise BadInput(f"options: gb.FitOptions(...) is needed, not {options!r:.60}.")
    chosen = given.choices(fix, free, prior, start, per_run)
    if isinstance(model, Vehicle):
        model, vehicle = None, model
    stated = given.vehicle(vehicle)
    if model is None or isinstance(model, str):  # what is wrong with it is better said before recordings are read
        requested: RequestedModel | Model = given.requested(model, stated, settings, effects, chosen)
    elif isinstance(model, RequestedModel):
        requested, stated = model, model.vehicle
    elif isinstance(model, Model):
        if vehicle is not None or settings:
            raise BadInput(
                "vehicle, settings: they are for a model that is given by its name. Pass them to the "
                "function of gb.models that makes this model."
            )
        requested = with_choices(given.model(model, None, effects), chosen)
    else:
        raise BadInput(f"model: a Model or its name is needed, not {model!r:.60}.")
    nominal = requested.model() if isinstance(requested, RequestedModel) else requested
    how.must_suit(nominal)
    training = given.recordings(recordings, columns)
    validate = None if validation is None else given.one_recording(validation, columns, "validation")
    learnt = (
        None if pretrain is None else pretraining(nominal, pretrain, pretrain_points, pretrain_range, pretrain_beyond)
    )
    return _fitted(requested, nominal, training, validate, how, learnt, progress or quiet)


def _fitted(
    requested: RequestedModel | Model,
    nominal: Model,
    training: Sequence[Recording],
    validation: Recording | None,
    options: FitOptions,
    known: Pretraining | TrainedBefore | None,
    say: Say,
) -> FitResult:
    """The fit of a model to recordings that were read.

    Parameters
    ----------
    requested : the model with what belongs to it as asked for, or the model itself.
    nominal : the model it asks for.
    training, validation : recordings.
    options : how to fit.
    known : what a network learns from first, or whose training is carried on.
    say : where progress goes.

    Raises
    ------
    BadInput : a recording lacks a signal that the model needs, or is shorter than the horizon; or they can carry no
        fit.
    """
    seen = (*training, *([validation] if validation is not None else []))
    must_be_recorded(nominal, seen)
    must_tell(nominal, training)
    models, vehicle, warnings = [requested] if isinstance(requested, Model) else [], None, list[str]()
    if isinstance(requested, RequestedModel):
        models, vehicle = requested.models(join(training, "training data")), requested.vehicle
        warnings = doubts(models[0], vehicle, training)
    if options.horizon is not None:
        must_suit(options.horizon, training)
    for warning in warnings:
        say(f"warning: {warning}")
    result = fit_model(
        models, training, validate=validation, how=options, say=say, pretraining=known,
        sensors={} if vehicle is None else vehicle.noise,
    )  # fmt: skip
    name = "" if vehicle is None else vehicle.name
    if name:
        result = replace(result, how={**result.how, "vehicle": name})
    return FitResult.of(result, seen, vehicle=name, warnings=tuple(warnings))


@by_kind
def pretraining(
    model: Model, source: Fit | Posterior | str | Path, points: int, span: Span, beyond: float = 1.0
) -> Pretraining | TrainedBefore:
    """The known vehicle of a fit, a posterior or the file of one, for a network to learn from, or a trained hybrid.

    Raises
    ------
    BadInput : the model has no network, or the source is none of equations of motion, or no fit of the same model.
    """
    raise BadInput(
        f"‹pretrain› is for models with a network that learns the motion; {model.name} is fitted to "
        "recordings only. Omit it."
    )


@understood
def load(
    path: str | Path,
    *,
    models: Model | str | Sequence[Model | str] = (),
    effects: Effect | str | Sequence[Effect | str] = (),
) -> FitResult:
    """Read a fit that was saved.

    A fit's file holds names and numbers and never runs code: equations of one's own are handed over again.

    Parameters
    ----------
    path : a file that `Fit.save` or `greybox fit` wrote.
    models, effects : those of one's own that it was made with, or "my_car.py:my_model", which runs that file.

    Returns
    -------
    Fit

    Raises
    ------
    BadInput : the file is no fit or is damaged, or it needs equations that are not at hand: the sentence says which.

    Warns
    -----
    UserWarning : the file of equations of one's own has changed since the fit was saved.

    Examples
    --------
    >>> import tempfile
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> fit = gb.fit("kinematic", lap, vehicle="roboracer")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = gb.load(fit.save(f"{folder}/fit.json"))
    >>> bool((again.params == fit.params).all())
    True
    """
    if not isinstance(path, str | Path):
        raise BadInput(f"path: the path of a fit's file is needed, not {path!r:.60}.")
    several = [models] if isinstance(models, Model | str) else list(models)
    value = [own_model(one) if isinstance(one, str) else one for one in several]
    added = [effects] if isinstance(effects, Effect | str) else list(effects)
    brought = [own_effect(one) if isinstance(one, str) else one for one in added]
    install()
    with known(*value, *brought):
        return FitResult.of(load_fit(path, build), file=Path(path))
