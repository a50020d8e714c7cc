"""The model that a diagnosis starts from: with its tolerances, and with every candidate effect at its null."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.errors import BadInput
from ...datasets.recording import Recording
from ...engine.simulation import Diagnosed, FreeRuns
from ...models.effect import AnyModel, Effect
from ...models.effects.sensors import velocity_lever_arm, velocity_mount_yaw
from ...models.memory_model import MemoryModel
from ...models.motion_model import MotionModel
from ...models.parameter import Parameter, Prior, Stated
from ...models.roughness import with_roughness
from ...models.single_track import G
from ...models.vehicle import Vehicle
from ...models.vehicles import stated_effect, with_tolerances
from .axes import ZONE
from .bench import Bench
from .calibration import CAL
from .memory_bench import MemoryBench
from .observer import SEEN, observed, with_seen
from .stable_slip import with_stable_slip
from .unknown_forces import with_unknown_forces

OBSERVED = {"v_x": 0.3, "yaw_rate": 0.0}
"""States that an observer keeps near their readings, and its rate, 1/s. That of the yaw rate is raised only where
simulations would spin otherwise."""
OF_VARIANCE = ("timestamp_jitter", "dropped_samples")
"""Effects that change no expected reading, only the scatter of readings (variance.py)."""


@dataclass(frozen=True)
class Prepared:
    """What is diagnosed.

    Attributes
    ----------
    nominal : the model with its tolerances; parameters without a prior are held.
    everything : the same with all candidates at their null; equations of motion with an observer.
    effects : candidates by name.
    """

    nominal: Diagnosed
    everything: Diagnosed
    effects: Mapping[str, Effect]

    def bench(self, recordings: Sequence[Recording]) -> FreeRuns:
        """What simulates `everything` over recordings."""
        if isinstance(self.everything, MemoryModel):
            return MemoryBench(self.everything, recordings)
        return Bench(self.everything, self.seen(recordings))

    def seen(self, recordings: Sequence[Recording]) -> list[Recording]:
        """Recordings with the inputs of observers."""
        result = list(recordings)
        for state in OBSERVED:
            if SEEN.format(state) in self.everything.inputs:
                result = [with_seen(recording, state) for recording in result]
        return result


def with_direction(
    vehicle: Vehicle | None, effects: Mapping[str, Effect], model: Diagnosed, recordings: Sequence[Recording]
) -> tuple[Vehicle | None, Mapping[str, Effect]]:
    """What is stated, with a tolerance of the direction in which v_y is read, and the effects with that one.

    No sensor is mounted along the car any better than this. At speed its v_y is then off by several times its noise,
    which else is an offset that a bank or a gyro's bias must explain. A file that states the direction, or every
    number as exact, is left as it is.
    """
    direction, arm = velocity_mount_yaw, velocity_lever_arm
    if vehicle is None or direction.name in vehicle.effects or all(it.sd is None for it in vehicle.values.values()):
        return vehicle, effects
    if arm.name not in effects or not any("v_y" in one for one in recordings) or not direction.concerns(model):
        return vehicle, effects
    stated = Stated(sd=CAL.scatter_imu_mount_yaw, source="as sensors are mounted")
    return replace(vehicle, effects={**vehicle.effects, direction.name: stated}), {**effects, direction.name: direction}


def excerpt(recordings: Sequence[Recording], most: int = CAL.most_rows) -> list[Recording]:
    """Recordings of at most `most` rows in all: blocks of them, spread evenly."""
    total = sum(len(recording) for recording in recordings)
    if total <= most:
        return list(recordings)
    blocks = list[tuple[Recording, int, int]]()
    for recording in recordings:
        length = max(1, round(CAL.excerpt_block / recording.sample_time))
        for start, stop in recording.runs:
            edges = np.linspace(start, stop, max(1, round((stop - start) / length)) + 1).astype(int)
            blocks += [(recording, int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    count = max(1, int(len(blocks) * most / total))
    chosen = np.unique(np.linspace(0, len(blocks) - 1, count).round().astype(int))
    return [item.rows(start, stop) for item, start, stop in (blocks[k] for k in chosen)]


def thinned(recordings: Sequence[Recording], most: int = CAL.most_rows) -> list[Recording]:
    """Recordings with rows left out evenly, so that at most `most` remain in all, as far as no motion is missed.

    20 rows a second inform a free run as well as 200, and all drives better than some of them. Where commands are held
    from row to row no row can be left out.
    """
    each, result = -(-sum(len(recording) for recording in recordings) // most), list[Recording]()
    for recording in recordings:
        step = min(each, int(CAL.thinnest / recording.sample_time + CAL.on_a_row)) if recording.hold == "linear" else 1
        if step <= 1:
            result.append(recording)
            continue
        kept = [np.arange(start, stop, step) for start, stop in recording.runs]
        edges, rows = np.cumsum([0, *(len(run) for run in kept)]), np.concatenate(kept)
        signals = {name: values[rows] for name, values in recording.signals.items()}
        runs = tuple((int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True))
        result.append(replace(recording, time=recording.time[rows], signals=signals, runs=runs))
    return result


def prepare(
    model: Diagnosed, recordings: Sequence[Recording], effects: Mapping[str, Effect], vehicle: Vehicle | None
) -> Prepared:
    """Add everything that a model may lack to it, at its null.

    Parameters
    ----------
    vehicle : its stated parameters; one stated without an sd is exact here. None: all priors of equations of motion
        count; those of learnt parameters do not, for they describe them as they were before a fit.
    """
    nominal = _with_form_errors(model, recordings, effects, vehicle)
    step = min(
        (float(np.median(np.diff(recording.time))) for recording in recordings if len(recording) > 1), default=0.0
    )
    nominal = _with_zones(nominal, effects, vehicle, step)
    everything, concerned = nominal, {}
    for name, effect in effects.items():
        if name in OF_VARIANCE or not (name in nominal.effects or effect.concerns(nominal)):
            continue
        concerned[name] = effect
        if effect.parameter.name not in nominal:  # else the model has it, as an effect or as a number of the equations
            everything = everything + effect.at(float(effect.parameter.array))
    if not concerned:
        raise BadInput(f"No effect acts on {model.name}: there is no cause to look for.")
    return Prepared(nominal, _observed(everything, recordings), concerned)


def prepare_plain(
    model: Diagnosed, recordings: Sequence[Recording], effects: Mapping[str, Effect], vehicle: Vehicle | None
) -> Prepared:
    """The model without candidates, if it is only simulated and refitted."""
    nominal = _with_form_errors(model, recordings, effects, vehicle)
    return Prepared(nominal, _observed(nominal, recordings), {})


def _with_form_errors(
    model: Diagnosed, recordings: Sequence[Recording], effects: Mapping[str, Effect], vehicle: Vehicle | None
) -> Diagnosed:
    if vehicle is None and model.learnt:
        vehicle = Vehicle(model.name)
    nominal = with_priors(model, effects, vehicle)
    return nominal if vehicle is None else with_roughness(nominal, vehicle, _usual(nominal, recordings))


def with_priors(model: AnyModel, effects: Mapping[str, Effect], vehicle: Vehicle | None) -> AnyModel:
    """The model with parameters that have priors free, and all others held; arguments as of `prepare`."""
    nominal = model.with_parameters(*(_held(parameter, vehicle) for parameter in model.parameters))
    return nominal if vehicle is None else with_tolerances(nominal, vehicle, effects)


def _usual(model: Diagnosed, recordings: Sequence[Recording]) -> dict[str, float]:
    """Median speed, m/s, and root mean squares of steering and drive; 1 where there is none."""
    result, signals = {}, {"speed": ("v_x",), "steer": ("steer",), "drive": model.aliases.get("drive", ("drive",))}
    for name, names in signals.items():
        held = [np.abs(one[signal]) for one in recordings for signal in names if signal in one]
        values = np.concatenate([each[np.isfinite(each)] for each in held]) if held else np.empty(0)
        size = 0.0
        if len(values):
            size = float(np.median(values) if name == "speed" else np.sqrt(np.mean(values**2)))
        result[name] = size if size > 0 else 1.0
    return result


def _with_zones(model: Diagnosed, effects: Mapping[str, Effect], vehicle: Vehicle | None, step: float) -> Diagnosed:
    """The model with a narrow prior about every effect's null: within it, a present effect does not matter.

    Where a vehicle's file states tolerances of its equations, effects that it says nothing about may be present a
    little all the same.
    """
    believed = [parameter for parameter in model.parameters if not parameter.fixed and parameter.prior is not None]
    if vehicle is None or isinstance(model, MemoryModel) or not believed:
        return model
    for name, effect in effects.items():
        if name in OF_VARIANCE or name in model.effects or not effect.concerns(model):
            continue
        if effect.gradual or effect.parameter.unit in ("s", "m"):  # effects that act with their square need no zone
            model = model + stated_effect(effect, Stated(sd=zone_of(model, effect, step), source=ZONE))
    return model


def zone_of(model: Diagnosed, effect: Effect, step: float) -> float:
    """Size of an effect that is negligible: a share of its usual size, and for timing at least one of a row, s."""
    zone = CAL.indifference * usual_size(model, effect)
    return max(zone, CAL.timing * step) if effect.parameter.unit == "s" else zone


def usual_size(model: Diagnosed, effect: Effect) -> float:
    """Usual size of an effect on this vehicle: lengths are in proportion to the wheelbase, forces to the weight."""
    unit, typical = effect.parameter.unit, abs(effect.typical - float(effect.parameter.array))
    if not isinstance(model, MotionModel):
        return typical
    held = {name: float(model[name].array) for name in ("m", "l_f", "l_r", "c_2") if name in model}
    if unit == "m" and {"l_f", "l_r"} <= held.keys():
        return CAL.of_wheelbase * (held["l_f"] + held["l_r"])
    if unit == "N" and "m" in held:
        return CAL.of_weight * held["m"] * G
    if unit == "N s^2/m^2" and held.get("c_2", 0.0) > 0:
        return CAL.of_drag * held["c_2"]
    return typical


def _observed(model: Diagnosed, recordings: Sequence[Recording]) -> Diagnosed:
    if not isinstance(model, MotionModel):
        return model
    states = [state.name for state in model.states]
    for state, rate in OBSERVED.items():
        if state in states and state in model.outputs and all(state in recording for recording in recordings):
            model = observed(model, state, rate)
    model = replace(model, passes=min(model.passes, CAL.passes))
    model = with_stable_slip(model)
    return model if model.learnt else with_unknown_forces(model)  # its network has absorbed unknown forces


def _held(parameter: Parameter, vehicle: Vehicle | None) -> Parameter:
    """A parameter of the equations or of an effect on them, held unless it has a prior."""
    if vehicle is None:
        return replace(parameter, fixed=parameter.fixed or parameter.prior is None)
    effects = vehicle.model.effects if vehicle.model is not None else {}
    stated = vehicle.values.get(parameter.name, effects.get(parameter.name))
    if stated is None or stated.sd is None:
        return replace(parameter, fixed=True)
    value = float(parameter.array) if stated.value is None else stated.value
    return replace(parameter, value=value, prior=Prior(stated.sd, mean=value), fixed=False)
