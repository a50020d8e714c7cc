"""Effects that vehicle models may lack. At its null value each of them leaves a model unchanged.

Order in which effects act, which defines how they compose:

    command -> steering_delay -> steering_backlash, steering_rate_limit, steering_lag, motor_lag (in the order added)
    -> steering_ratio, steering_offset, motor_gain and changed parameters -> slip angles and their relaxation -> loads
    -> friction -> forces -> motion -> readings (in the order added) -> latencies -> recording

Alterations of one quantity act in the order in which they were added; most are products, whose order does not matter.
Loads and accelerations depend on each other: for effects on loads the equations are evaluated a few times, each time
with the accelerations of the previous pass.

Some effects have a second parameter, held at a usual value (an energy, a direction, a natural frequency).
"""

from ..effect import Effect
from . import body, drive, road, sensors, steering, timing, tyres
from .steering import steering_rate_limit
from .timing import sensor_latency_imu

EFFECTS: dict[str, Effect] = {
    effect.name: effect for group in (steering, drive, tyres, body, road, sensors, timing) for effect in group.ALL
}
"""Effects by name."""


def vocabulary() -> dict[str, Effect]:
    """Effects that a diagnosis tries if none are named."""
    return {name: effect for name, effect in EFFECTS.items() if not effect.by_name}


__all__ = ["EFFECTS", "sensor_latency_imu", "steering_rate_limit", "vocabulary"]
