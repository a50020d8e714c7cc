"""Identify vehicle models from recordings, with honest uncertainty, on CasADi.

    import greybox_id as gb
    lap, other = gb.read("lap7.csv", columns="roboracer"), gb.read("lap8.csv", columns="roboracer")
    fit = gb.fit("single_track", lap, vehicle="roboracer", validation=other)
    print(fit.summary()); fit.conf_int(); fit.score(other); fit.plot.tyres()
    gap = gb.diagnose(fit, other); gap.plot(); gb.export(gap.closed_model, to="car/")

A name is loaded when it is first asked for (PEP 562), so that `import greybox_id` costs nothing.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING

from .base.version import __version__ as __version__

if TYPE_CHECKING:  # for editors and type checkers; a test holds it and the table below together
    from . import datasets as datasets
    from .api import effects as effects
    from .api import models as models
    from .api.adapting import adapt as adapt
    from .api.designing import design as design
    from .api.diagnosing import diagnose as diagnose
    from .api.exporting import export as export
    from .api.fit_result import FitResult
    from .api.fitting import fit as fit
    from .api.fitting import load as load
    from .api.gap_result import GapResult
    from .api.gridding import grid as grid
    from .api.models import KnownVehicle
    from .api.predictions import predict as predict
    from .api.predictions import score as score
    from .api.predictions import simulate as simulate
    from .api.profiles import profile as profile
    from .api.reading import check as check
    from .api.reading import read as read
    from .api.reporting import report as report
    from .api.sampling import PosteriorResult
    from .api.sampling import sample as sample
    from .api.track_result import TrackResult
    from .api.tracking import track as track
    from .base.errors import BadInput as BadInput
    from .base.errors import BadModel as BadModel
    from .base.errors import GreyboxError as GreyboxError
    from .datasets.recording import Recording as Recording
    from .filters.how import TrackOptions as TrackOptions
    from .fitting.how import FitOptions as FitOptions

    Fit = FitResult
    Gap = GapResult
    Vehicle = KnownVehicle
    Posterior = PosteriorResult
    Track = TrackResult

_PLACES = {
    "read": "api.reading:read",
    "check": "api.reading:check",
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
    "export": "api.exporting:export",
    "report": "api.reporting:report",
    "datasets": "datasets:",
    "models": "api.models:",
    "effects": "api.effects:",
    "Recording": "datasets.recording:Recording",
    "Vehicle": "api.models:KnownVehicle",
    "Fit": "api.fit_result:FitResult",
    "FitOptions": "fitting.how:FitOptions",
    "Gap": "api.gap_result:GapResult",
    "Track": "api.track_result:TrackResult",
    "TrackOptions": "filters.how:TrackOptions",
    "Posterior": "api.sampling:PosteriorResult",
    "GreyboxError": "base.errors:GreyboxError",
    "BadInput": "base.errors:BadInput",
    "BadModel": "base.errors:BadModel",
}
"""Name at the top level -> module and name within it; nothing behind the colon is the module itself."""

_MOVED = {
    "shipped": "datasets.shipped",
    **{
        name: f"models.{name}" for name in ("Parameter", "Prior", "Model", "MotionModel", "State", "Stated", "vehicles")
    },
    **{name: f"effects.{name}" for name in ("Effect", "alteration")},
    **{name: f"datasets.checks.{name}" for name in ("Finding", "Severity")},
    "Adaptation": "api.adapting.AdaptationResult",
    "Grid": "api.gridding.GridResult",
    "Profile": "fitting.uncertainty.profile.Profile",
}
"""Name that stood at the top level before its room did -> where it stands in its room."""

__all__ = list(_PLACES)

for _room in ("export", "models"):  # once these rooms are imported, the verb and the table of these names stay
    _import_module(f".{_room}", __name__)
    del globals()[_room]


def __getattr__(name: str) -> object:
    if name in _MOVED:
        return _moved(name)
    if name not in _PLACES:
        from .base.errors import near

        raise AttributeError(f"greybox_id has no {name!r}.{near(name, _PLACES)}")
    module, _, inside = _PLACES[name].partition(":")
    loaded = _import_module(f".{module}", __name__)
    return globals().setdefault(name, getattr(loaded, inside) if inside else loaded)


def _moved(name: str) -> object:
    from warnings import warn

    room, _, inside = _MOVED[name].rpartition(".")
    place = f"{'gb' if room in _PLACES else 'greybox_id'}.{_MOVED[name]}"
    warn(f"gb.{name} is {place} now.", DeprecationWarning, stacklevel=3)
    return getattr(__getattr__(room) if room in _PLACES else _import_module(f".{room}", __name__), inside)


def __dir__() -> list[str]:
    return sorted((*__all__, "__version__"))
