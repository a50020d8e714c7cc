"""What the tests of functional mock-up units share: vehicles driven for a minute, by us and as units under FMPy."""

import shutil

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from greybox_id.datasets.recording import Recording
from greybox_id.export.subject import Subject
from greybox_id.export.verb import export
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

STEP, MINUTE = 0.01, 6001
TAIL = 20
"""Rows after the minute: readings that are late cut steps, and behind the last row nothing is read."""
VEHICLES = {
    "full_size_car": (15.0, 0.03, 1.0),
    "roboracer": (3.0, 0.1, 0.4),
    "truck": (12.0, 0.05, 0.4),
}
"""Vehicle -> speed at the start [m/s], steering [rad], swing of the acceleration about what keeps the speed [m/s^2]."""
SETS = {
    "actuators": {"steering_delay": 0.037, "steering_lag": 0.05, "motor_lag": 0.1, "steering_rate_limit": 0.6},
    "sensors": {
        "sensor_latency_imu": 0.023, "sensor_latency_vx": 0.05, "load_sensitivity": 0.1, "steering_offset": 0.002,
        "accel_bias_y": 0.05,
    },
    "tyres": {"tyre_relaxation": 0.3, "steering_backlash": 0.002, "grip_scale": 0.9, "combined_slip": 0.8},
}  # fmt: skip


def made(folder, name, effects, moving=None):
    """A vehicle with effects, exported; the model and the folder."""
    own = vehicle(name)
    model = build("single_track", {}, effects, own)
    export(Subject(model, "car", moving, source="a test", vehicle=own), "fmu", folder)
    return model, folder


def driven(name, model, rows=MINUTE + TAIL):
    """Time, steering, drive and states at the start."""
    speed, steer, swing = VEHICLES[name]
    rng, t = np.random.default_rng(1), np.arange(rows) * STEP
    m, c_0, c_1, c_2, force = (float(model[own].array) for own in ("m", "c_0", "c_1", "c_2", "force_per_unit"))
    mean = (c_0 + c_1 * speed + c_2 * speed**2) / m
    jumps = np.repeat(rng.standard_normal(rows // 50 + 1), 50)[:rows]
    steering = steer * (np.sin(0.7 * t) + 0.3 * np.sin(2.9 * t + 1) + 0.2 * jumps)
    bumps = np.repeat(rng.standard_normal(rows // 20 + 1), 20)[:rows]
    drive = mean + swing * (np.sin(0.5 * t) + 0.2 * bumps)
    return t, steering, drive * m / force, {"v_x": speed, "v_y": 0.0, "yaw_rate": 0.0}


def simulated(model, t, steering, drive, start):
    """(rows, outputs) of our own simulation."""
    recording = Recording("driven", t, {"steer": steering, "ax_cmd": drive}, runs=((0, len(t)),))
    return simulate(model, recording, start).predicted


class Unit:
    """A unit loaded by FMPy; both versions of FMI behave alike here."""

    def __init__(self, path, folder):
        description = fmpy.read_model_description(str(path))
        self.folder = fmpy.extract(str(path), str(folder))
        self.references = {own.name: own.valueReference for own in description.modelVariables}
        self.outputs = [own.name for own in description.modelVariables if own.causality == "output"]
        self.three = description.fmiVersion.startswith("3")
        kind = FMU3Slave if self.three else FMU2Slave
        self.fmu = kind(
            guid=description.instantiationToken if self.three else description.guid,
            unzipDirectory=self.folder,
            modelIdentifier="car",
            instanceName="unit",
        )
        self.fmu.instantiate()

    def set(self, **values):
        """Variables by name; dots in names are written as two underscores."""
        names = [name.replace("__", ".") for name in values]
        setter = self.fmu.setFloat64 if self.three else self.fmu.setReal
        setter([self.references[name] for name in names], list(values.values()))

    def get(self, *names):
        getter = self.fmu.getFloat64 if self.three else self.fmu.getReal
        return getter([self.references[name] for name in names or self.outputs])

    def begin(self, **values):
        """Start with these values at zero seconds."""
        if not self.three:
            self.fmu.setupExperiment(startTime=0.0)
        self.set(**values)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def step(self, time, length):
        return self.fmu.doStep(time, length)

    def run(self, t, steering, drive, start):
        """(rows, outputs) as read just after a row's commands are set."""
        self.begin(**{f"state__{name}": value for name, value in start.items()}, steer=steering[0], drive=drive[0])
        found = []
        for k in range(len(t)):
            self.set(steer=steering[k], drive=drive[k])
            found.append(self.get())
            if k + 1 < len(t):
                self.step(t[k], t[k + 1] - t[k])
        return np.array(found)

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)
