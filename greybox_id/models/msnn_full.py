"""MS-NN-full: the coupled lateral and longitudinal dynamics, MS-NN-lat and MS-NN-long in a closed loop.

The predicted longitudinal acceleration takes the place of the measured one in MS-NN-lat's window, and the
predicted yaw rate times speed that of the lateral acceleration in MS-NN-long's.

Source: Mungiello et al., "Vehicle dynamics learning from physics priors with model-structured neural
networks", Fig. 1a and Sec. II-D.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

from ..errors import BadInput
from ..memory_model import MemoryModel, Past
from ..model import Namespace, Symbol
from ..recording import Recording
from .msnn_lat import LateralSettings, covering_lat, msnn_lat
from .msnn_long import LongitudinalSettings, covering_long, msnn_long


@dataclass(frozen=True)
class FullSettings:
    """Hyperparameters of both parts.

    Attributes
    ----------
    lat, long : those of MS-NN-lat and MS-NN-long.
    refine_longitudinal : let step 2 move the longitudinal part too, as the paper does. Off, step 2 refines the lateral
        part on predicted accelerations and leaves the longitudinal part as its own output told it: in a common
        objective the yaw rate's residuals bend the acceleration that feeds them.
    """

    lat: LateralSettings = field(default_factory=LateralSettings)
    long: LongitudinalSettings = field(default_factory=LongitudinalSettings)
    refine_longitudinal: bool = False


def covering_full(settings: FullSettings, recording: Recording, symmetric: bool = False) -> FullSettings:
    """Centres left open are set from a training recording."""
    return FullSettings(
        covering_lat(settings.lat, recording, symmetric),
        covering_long(settings.long, recording, symmetric),
        settings.refine_longitudinal,
    )


def msnn_full(settings: FullSettings | None = None) -> MemoryModel:
    """MS-NN-full; 544 parameters with the authors' hyperparameters."""
    s = settings or FullSettings()
    lat, long = msnn_lat(s.lat), msnn_long(s.long)
    if lat.sample_time != long.sample_time:
        raise BadInput(
            f"MS-NN-lat is set to samples of {lat.sample_time:g} s and MS-NN-long to {long.sample_time:g} s; "
            "one loop needs one sample time."
        )

    def equations(u: Namespace, p: Namespace, past: Past) -> dict[str, Symbol]:
        return {**lat.equations(u, p, past), **long.equations(u, p, past)}

    inputs = tuple(dict.fromkeys(lat.inputs + long.inputs))

    def feedback(y: Namespace, u: Namespace) -> dict[str, Symbol]:
        fed = {"a_x": y.a_x, "a_y": y.yaw_rate * u.v_x}
        return {name: own for name, own in fed.items() if name in inputs}

    return MemoryModel(
        name="msnn_full",
        about="model-structured network of the coupled dynamics, closed loop: yaw rate and acceleration",
        inputs=inputs,
        outputs=lat.outputs + long.outputs,
        parameters=lat.parameters + long.parameters,
        equations=equations,
        feedback=feedback if {"a_x", "a_y"} & set(inputs) else None,
        sample_time=lat.sample_time,
        defaults=long.defaults,
        parts=(lat, long),
        step_2_holds=() if s.refine_longitudinal else tuple(p.name for p in long.parameters),
        settings=asdict(s),
        together=lat.together + long.together,
    )
