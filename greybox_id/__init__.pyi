"""What `__init__` loads on demand, for editors and type checkers; a test holds the two together."""

from .api import effects as effects
from .api import models as models
from .api.adapting import AdaptationResult
from .api.adapting import adapt as adapt
from .api.designing import design as design
from .api.diagnosing import diagnose as diagnose
from .api.fit_result import FitResult
from .api.fitting import fit as fit
from .api.fitting import load as load
from .api.gap_result import GapResult
from .api.gridding import GridResult
from .api.gridding import grid as grid
from .api.handing_over import export as export
from .api.handing_over import report as report
from .api.known_vehicle import KnownVehicle
from .api.predictions import predict as predict
from .api.predictions import score as score
from .api.predictions import simulate as simulate
from .api.profiles import profile as profile
from .api.reading import check as check
from .api.reading import read as read
from .api.reading import vehicles as vehicles
from .api.sampling import PosteriorResult
from .api.sampling import sample as sample
from .api.track_result import TrackResult
from .api.tracking import track as track
from .base.errors import BadInput as BadInput
from .base.errors import BadModel as BadModel
from .base.errors import GreyboxError as GreyboxError
from .datasets.checks.finding import Finding as Finding
from .datasets.checks.finding import Severity as Severity
from .datasets.recording import Recording as Recording
from .datasets.shipped import shipped as shipped
from .filters.how import TrackOptions as TrackOptions
from .fitting.how import FitOptions as FitOptions
from .fitting.uncertainty.profile import Profile as Profile
from .models.effect import Effect as Effect
from .models.effects.stating import alteration as alteration
from .models.model import Model as Model
from .models.motion_model import MotionModel as MotionModel
from .models.motion_model import State as State
from .models.parameter import Parameter as Parameter
from .models.parameter import Prior as Prior
from .models.vehicle import Stated as Stated

__version__: str

Adaptation = AdaptationResult
Fit = FitResult
Gap = GapResult
Grid = GridResult
Posterior = PosteriorResult
Track = TrackResult
Vehicle = KnownVehicle
__all__: list[str]
