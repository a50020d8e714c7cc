"""Fits of models to recordings, and fits from files."""

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
"""Called with each line of progress."""


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
    model : a model (from `gb.models`, or your own), its name, or "my_car.py:my_model"; None, or a vehicle, uses the
        vehicle's model. Its nominal values are the initial values.
    recordings : training data: one recording or a list, as recordings or files; a name may be a pattern.
    validation : a recording that is only scored, except with early stopping, which it controls.
    vehicle : with the initial values of a model given by name: a `Vehicle`, a shipped name or a file.
    settings : hyperparameters of a model given by name, such as {"tyre": "brush"}.
    effects : names of effects that are added, "steering_delay" (estimated) or "steering_delay=30ms" (fixed).
    fix : names of parameters that are fixed; or name -> value to fix them at, a number in SI or a text with a unit.
    free : names of parameters that are estimated although the model fixes them.
    prior : name -> (mean, sd), estimated with that prior.
    start : name -> initial value of the estimation.
    per_run : names of parameters that have one value per run.
    columns : column map for files.
    options : horizon, starting points, solver, seed.
    pretrain : for mlp_lateral and bicycle_mlp, a fit or posterior of equations of motion, or its file, on which the
        network is pretrained; bicycle_mlp also takes its physics from it. For hybrid_stiffness and hybrid_force, a fit
        of the same model, whose training is continued: 20 s suffice for a vehicle with other tyres.
    pretrain_points, pretrain_range : number of points, on rows of the recordings ("data") or in a range 1.3 times as
        wide ("box").
    pretrain_beyond : for speeds outside the data: pretrain up to this multiple, 1 to 3, of the largest recorded speed.
    progress : called with each line of progress.

    Returns
    -------
    Fit
        Estimates with intervals (`params`, `stderr`, `conf_int()`), `summary()`, `score(...)`, `plot`, and more. Ctrl-C
        keeps the best point so far, which the stage's status mentions.

    Raises
    ------
    BadInput : if a name is unknown, a recording lacks a signal, differs in sample time or is too short, or none
        contains motion.

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
    if model is None or isinstance(model, str):  # report errors in it before reading recordings
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
    """Fit a model to recordings that were read.

    Parameters
    ----------
    requested : the model with vehicle, effects and choices as requested, or the model itself.
    nominal : the requested model.
    training, validation : recordings.
    options : of the fit.
    known : data for pretraining a network, or an earlier training to continue.
    say : called with lines of progress.

    Raises
    ------
    BadInput : if a recording lacks a signal that the model needs, or is shorter than the horizon; or if the recordings
        are not sufficient for a fit.
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
    """Pretraining data from a fit, a posterior or the file of either, or a trained hybrid to continue.

    Raises
    ------
    BadInput : if the model has no network, or the source is not of equations of motion, or not of the same model.
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
    """Read a saved fit.

    A fit's file contains names and numbers and never executes code: pass your own equations again.

    Parameters
    ----------
    path : a file written by `Fit.save` or `greybox fit`.
    models, effects : your own that the fit uses, or "my_car.py:my_model", which executes that file.

    Returns
    -------
    Fit

    Raises
    ------
    BadInput : if the file is not a fit or is damaged, or needs equations that are not available, which are then named.

    Warns
    -----
    UserWarning : if the file of your own equations has changed since the fit was saved.

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
    own_models = [own_model(one) if isinstance(one, str) else one for one in several]
    added = [effects] if isinstance(effects, Effect | str) else list(effects)
    own_effects = [own_effect(one) if isinstance(one, str) else one for one in added]
    install()
    with known(*own_models, *own_effects):
        return FitResult.of(load_fit(path, build), file=Path(path))
