"""Identify vehicle models from recordings, with honest uncertainty, on CasADi.

    import greybox_id as gb
    lap, other = gb.read("lap7.csv", columns="roboracer"), gb.read("lap8.csv", columns="roboracer")
    fit = gb.fit("single_track", lap, vehicle="roboracer", validation=other)
    print(fit.summary()); fit.conf_int(); fit.score(other); fit.plot.tyres()
    gap = gb.diagnose(fit, other); gap.plot(); gb.export(gap.closed_model, to="car/")

What stands in `__all__` is loaded when it is first asked for, so that `import greybox_id` costs nothing.
"""

import sys
from importlib import import_module
from types import ModuleType

from .base.version import __version__ as __version__

_PLACES = {
    "read": "api.reading:read",
    "check": "api.reading:check",
    "vehicles": "api.reading:vehicles",
    "shipped": "datasets.shipped:shipped",
    "fit": "api.fitting:fit",
    "load": "api.fitting:load",
    "simulate": "api.predictions:simulate",
    "predict": "api.predictions:predict",
    "score": "api.predictions:score",
    "profile": "api.profiles:profile",
    "sample": "api.sampling:sample",
    "adapt": "api.adapting:adapt",
    "grid": "api.gridding:grid",
    "track": "api.tracking:track",
    "diagnose": "api.diagnosing:diagnose",
    "design": "api.designing:design",
    "export": "api.handing_over:export",
    "report": "api.handing_over:report",
    "models": "api.models:",
    "effects": "api.effects:",
    "alteration": "models.effects.stating:alteration",
    "Recording": "datasets.recording:Recording",
    "Parameter": "models.parameter:Parameter",
    "Prior": "models.parameter:Prior",
    "Model": "models.model:Model",
    "MotionModel": "models.motion_model:MotionModel",
    "State": "models.motion_model:State",
    "Effect": "models.effect:Effect",
    "Vehicle": "api.known_vehicle:KnownVehicle",
    "Stated": "models.vehicle:Stated",
    "Fit": "api.fit_result:FitResult",
    "FitOptions": "fitting.how:FitOptions",
    "Adaptation": "api.adapting:AdaptationResult",
    "Grid": "api.gridding:GridResult",
    "Gap": "api.gap_result:GapResult",
    "Track": "api.track_result:TrackResult",
    "TrackOptions": "filters.how:TrackOptions",
    "Profile": "fitting.uncertainty.profile:Profile",
    "Posterior": "api.sampling:PosteriorResult",
    "Finding": "datasets.checks.finding:Finding",
    "Severity": "datasets.checks.finding:Severity",
    "GreyboxError": "base.errors:GreyboxError",
    "BadInput": "base.errors:BadInput",
    "BadModel": "base.errors:BadModel",
}
"""Name at the top level -> module and name within it; nothing behind the colon is the module itself."""

__all__ = list(_PLACES)


def __getattr__(name: str) -> object:
    if name not in _PLACES:
        from .base.errors import near

        raise AttributeError(f"greybox_id has no {name!r}.{near(name, _PLACES)}")
    module, _, inside = _PLACES[name].partition(":")
    result = import_module(f".{module}", __name__)
    return vars(sys.modules[__name__]).setdefault(name, getattr(result, inside) if inside else result)


def __dir__() -> list[str]:
    return sorted((*__all__, "__version__"))


class _TopLevel(ModuleType):
    """This package, in which `export` and `models` stay what a person calls when the rooms so called are imported."""

    def __setattr__(self, name: str, value: object) -> None:
        if name not in _PLACES or not isinstance(value, ModuleType):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _TopLevel
