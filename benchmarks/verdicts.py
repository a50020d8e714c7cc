"""Are verdicts on fits right? Drawn fits, good, poor and hopeless, judged and then examined on clean held-out data.

    GREYBOX_DATA=folder python benchmarks/verdicts.py --seed 1 --fits 200 --out verdicts.json

A fit's error is the geometric mean, over outputs and the horizons of `HORIZONS`, of RMSE over the spread of the
readings, on a held-out recording as it really was. The best known is the least of all fits of the same model and
recording, those of the whole recording from the right vehicle among them. Two figures decide: "usable" given to a fit
whose error is more than 1.5 times the best known (none should), and "not usable" given to one within 1.1 times (at most
2 %).

A fifth is hopeless on purpose: a column in a wrong unit, turned, constant, shuffled or taken for another. Recordings
are virtual vehicles of four classes, one with other forms than models have, one that races from standstill at 25 Hz,
the shipped synthetic racer and, where GREYBOX_DATA names them, three real ones. Drawn are recording, model, start (the
right vehicle, the model's own numbers, another vehicle, random factors), window and horizon, and whether there is
validation.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from greybox_id.base.errors import GreyboxError
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.datasets.shipped import shipped
from greybox_id.engine.motion.simulator import Simulator
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.scores.metrics import ahead
from greybox_id.fitting.scores.motion import score_motion
from greybox_id.fitting.verb import fit
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build
from greybox_id.models.vehicle import Vehicle
from greybox_id.models.vehicle import vehicle as vehicle_of
from greybox_lab.virtual.virtual_vehicle import drive, random_vehicle
from greybox_lab.virtual.virtual_vehicle.drive import steered

HORIZONS = (0.5, 1.0, 2.0)
MODELS = ("lateral", "kinematic", "single_track", "longitudinal")
ASTRAY, NEAR = 1.5, 1.1
HOPELESS = 0.2
PATIENCE = 20
"""CPU s after which a fit is given up; it does not count."""
OTHERS = ("full_size_car", "roboracer", "truck", "simrod")


@dataclass(frozen=True)
class Case:
    """A vehicle's recordings: to fit to, and held out."""

    name: str
    train: Recording
    held_out: Recording
    vehicle: Vehicle | None


def stated(car):
    """What an engineer would state of a virtual vehicle: geometry and mass exactly, all else roughly."""
    rng = np.random.default_rng(7)
    known = ("m", "l_f", "l_r", "h_cg", "track_f", "track_r", "wheel_radius")
    values = {}
    for name, value in car.parameters.items():
        off = value * (1 + (0.0 if name in known else 0.1 * rng.standard_normal()))
        values[name] = Stated(off) if name in known or value == 0 else Stated(off, 0.3 * abs(value))
    return Vehicle(car.name, values)


def virtual(kind, seed, forms="nominal"):
    car = random_vehicle(seed, kind)
    recordings = [drive(car, "mixed", 40.0, 50.0, seed=seed + k, forms=forms)[0] for k in (0, 50)]
    return Case(f"{kind} {forms}", *recordings, stated(car))


def racing(seed):
    """From standstill to 70 m/s, at 25 Hz."""
    car = random_vehicle(3, "sports")
    of_its_own = {
        "m": 787.0, "I_z": 1000.0, "l_f": 1.62, "l_r": 1.36, "c_0": 100.0, "c_2": 0.6, "force_per_unit": 787.0,
        "B_f": 14.0, "B_r": 16.0, "D_f": 1.6, "D_r": 1.7,
    }  # fmt: skip
    noise = {**car.noise, "v_x": 0.05, "v_y": 0.05, "yaw_rate": 0.005, "a_x": 0.2, "a_y": 0.3}
    car = replace(
        car, parameters={**car.parameters, **of_its_own}, top_speed=70.0, small={}, drive_channel="ax_cmd", noise=noise
    )
    found = []
    for k in (0, 1):
        rng, t = np.random.default_rng(seed + k), np.arange(1500) / 25.0
        speed = np.interp(t, [0, 3, 20, 30, 40, 50, 60], [0, 0.0, 70, 40, 68, 45, 70])
        a_y = 3.75 * sum(np.sin(2 * np.pi * (f * t + rng.random())) for f in (0.03, 0.07, 0.15, 0.3))
        steer = np.where(speed > 3, a_y * (2.98 / np.maximum(speed, 8) ** 2 + 5e-4), 0.0)
        found.append(steered(car, f"racing {k}", steer, speed, rate=25.0, seed=seed + k)[0])
    return Case("racing 25 Hz", *found, stated(car))


def cases(seed):
    found = [
        virtual("racer", seed), virtual("car", seed + 1), virtual("truck", seed + 2), virtual("sports", seed + 3),
        virtual("car", seed + 4, "other"), racing(seed),
        Case("shipped racer", *(read(shipped(n), "roboracer") for n in ("racer_train", "racer_valid")),
             vehicle_of("roboracer")),
    ]  # fmt: skip
    if folder := os.environ.get("GREYBOX_DATA"):
        data = Path(folder)
        pair = [read(data / "roboracer" / f"{n}.csv", "roboracer") for n in ("train", "valid")]
        found.append(Case("roboracer", *pair, vehicle_of("roboracer")))
        whole = read(data / "revs_250lm" / "run1_first400s.csv.gz", "revs_250lm")
        found.append(Case("250 LM", whole.rows(0, 5000), whole.rows(20000, 25000), vehicle_of("ferrari_250lm")))
        whole = read(data / "truck" / "val.parquet", "truck")
        found.append(Case("truck runs", whole.rows(0, 6000), whole.rows(40000, 46000), vehicle_of("truck")))
    return found


SPOILT = {
    "a_y in g": lambda s, rng: {"a_y": s["a_y"] / 9.81},
    "yaw rate in deg/s": lambda s, rng: {"yaw_rate": np.degrees(s["yaw_rate"])},
    "v_x in km/h": lambda s, rng: {"v_x": 3.6 * s["v_x"]},
    "steering turned": lambda s, rng: {"steer": -s["steer"]},
    "yaw rate turned": lambda s, rng: {"yaw_rate": -s["yaw_rate"]},
    "yaw rate constant": lambda s, rng: {"yaw_rate": np.full(len(s["yaw_rate"]), 0.3)},
    "steering shuffled": lambda s, rng: {"steer": rng.permutation(s["steer"])},
    "v_x and v_y swapped": lambda s, rng: {"v_x": s["v_y"], "v_y": s["v_x"]},
    "a_x and a_y swapped": lambda s, rng: {"a_x": s["a_y"], "a_y": s["a_x"]},
    "steering is noise": lambda s, rng: {"steer": 0.1 * rng.standard_normal(len(s["steer"]))},
    "drive turned": lambda s, rng: {own: -s[own] for own in ("ax_cmd", "drive_force", "motor_current") if own in s},
}


def spoil(recording, how, rng):
    return recording.with_signals(**SPOILT[how](recording.signals, rng))


def suits(model, case):
    names = {*case.train.signals}
    inputs = all(
        any(own in names for own in model.aliases.get(name, (name,))) or name in model.defaults for name in model.inputs
    )
    return inputs and any(name in names for name in model.outputs)


def hits(how, model):
    """Whether a fault is in something the model uses."""
    touched = set(how.replace("_", " ").split()) and {
        "a_y in g": {"a_y"}, "yaw rate in deg/s": {"yaw_rate"}, "v_x in km/h": {"v_x"}, "steering turned": {"steer"},
        "yaw rate turned": {"yaw_rate"}, "yaw rate constant": {"yaw_rate"}, "steering shuffled": {"steer"},
        "v_x and v_y swapped": {"v_x"}, "a_x and a_y swapped": {"a_x", "a_y"}, "steering is noise": {"steer"},
        "drive turned": {"drive"},
    }[how]  # fmt: skip
    return bool(touched & {*model.inputs, *model.outputs})


def has(how, recording):
    try:
        return bool(SPOILT[how](recording.signals, np.random.default_rng(0)))
    except KeyError:
        return False


def started(name, case, kind, rng):
    if kind == "right":
        return build(name, None, {}, case.vehicle)
    if kind == "own":
        return build(name)
    if kind == "other":
        return build(name, None, {}, vehicle_of(str(rng.choice(OTHERS))))
    model = build(name, None, {}, case.vehicle)
    changed = []
    for p in model.parameters:
        if not p.fixed and p.shape == () and float(p.array) != 0:
            value = float(np.clip(float(p.array) * np.exp(0.7 * rng.standard_normal()), *p.bounds))
            changed.append(p.with_value(value))
    return model.with_parameters(*changed)


def error(model, recording):
    scores = score_motion(Simulator(model), recording, model.values, HORIZONS)
    ratios = [
        e.rmse / e.spread for h in HORIZONS for e in scores.get(ahead(h), {}).values() if e.spread > 0
    ]  # fmt: skip
    return float(np.exp(np.mean(np.log(ratios)))) if ratios and np.all(np.isfinite(ratios)) else np.inf


def draw(found, k, seed):
    """A fit to make: the case, the model as it starts, recordings, options, and what it is."""
    rng = np.random.default_rng([seed, k])
    case = found[k % len(found)]
    hopeless = rng.random() < HOPELESS
    while True:
        name = str(rng.choice(MODELS, p=(0.45, 0.2, 0.25, 0.1)))
        if not suits(build(name), case):
            continue
        start = str(rng.choice(("right", "own", "other", "random"), p=(0.45, 0.15, 0.15, 0.25)))
        model = started(name, case, start, rng)
        fault = str(rng.choice(list(SPOILT))) if hopeless else ""
        if not fault or (hits(fault, model) and has(fault, case.train)):
            break
    train, held_out, window = case.train, case.held_out, "whole"
    if rng.random() < 0.4:
        seconds = float(rng.choice((5.0, 10.0, 20.0)))
        rows = round(seconds / train.sample_time)
        begin = int(rng.integers(0, max(1, len(train) - rows)))
        train, window = train.rows(begin, min(begin + rows, len(train))), f"{seconds:g} s"
    if fault:
        train, held_out = spoil(train, fault, rng), spoil(held_out, fault, rng)
    horizon = None if rng.random() < 0.7 else 1.0
    validate = held_out if rng.random() < 0.75 else None
    told = {"case": case.name, "model": name, "start": start, "fault": fault, "window": window, "horizon": horizon}
    return case, model, train, validate, FitOptions(horizon=horizon), told | {"validated": validate is not None}


def one(case, model, train, validate, how, told):
    clock = time.process_time()
    try:
        signal.setitimer(signal.ITIMER_PROF, PATIENCE, 5.0)
        found = fit(model, [train], validate=validate, how=how)
        signal.setitimer(signal.ITIMER_PROF, 0)
        told |= {"verdict": found.verdict.usability, "reasons": list(found.verdict.reasons)}
        told |= {"error": error(found.model, case.held_out), "confirmed": found.confirmed}
    except GreyboxError as refusal:
        told |= {"verdict": "refused", "reasons": [str(refusal)], "error": np.inf}
    except TimeoutError:
        told |= {"verdict": "given up", "reasons": [], "error": np.inf}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return told | {"cpu_seconds": round(time.process_time() - clock, 1)}


def summed(results, references):
    best = dict(references)
    for own in results:
        key = f"{own['case']}, {own['model']}"
        best[key] = min(best.get(key, np.inf), own["error"])
    for own in results:
        own["ratio"] = own["error"] / best[f"{own['case']}, {own['model']}"]
    judged = [own for own in results if own["verdict"] not in ("refused", "given up")]
    near = [own for own in judged if own["ratio"] <= NEAR]
    far = [own for own in judged if own["ratio"] > ASTRAY]
    return {
        "fits": len(results),
        "verdicts": dict(Counter(own["verdict"] for own in results)),
        "within 1.1 of the best known": len(near),
        "of these, of sound data": sum(not own["fault"] for own in near),
        "of these, of sound data, not usable": sum(own["verdict"] == "not usable" and not own["fault"] for own in near),
        "of these not usable": [own for own in near if own["verdict"] == "not usable"],
        "of these usable": sum(own["verdict"] == "usable" for own in near),
        "beyond 1.5 of the best known": len(far),
        "of those usable": [own for own in far if own["verdict"] == "usable"],
        "of those not usable": sum(own["verdict"] == "not usable" for own in far),
        "of those with care": [own for own in far if own["verdict"] == "usable with care"],
        "cpu_seconds": sum(own["cpu_seconds"] for own in results),
    }


def whole(results, references):
    return {"summary": summed(results, references), "fits": results, "references": references}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fits", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=np.inf, help="No new fit is begun after so many.")
    parser.add_argument("--out", type=Path, help="Goes on where it was left, if it is there.")
    asked = parser.parse_args()

    def late(*_):
        raise TimeoutError

    signal.signal(signal.SIGPROF, late)
    begun, found, results, references = time.monotonic(), cases(asked.seed), [], {}
    if asked.out and asked.out.exists():
        before = json.loads(asked.out.read_text())
        results, references = before["fits"], before["references"]
    for k in range(len(results), asked.fits):
        if time.monotonic() - begun > asked.seconds:
            break
        case, model, train, validate, how, told = draw(found, k, asked.seed)
        key = f"{case.name}, {told['model']}"
        if key not in references:
            right = build(told["model"], None, {}, case.vehicle)
            references[key] = one(case, right, case.train, None, FitOptions(solver="gauss-newton"), {})["error"]
        results.append(one(case, model, train, validate, how, told))
        own = results[-1]
        words = ", ".join(str(told[name]) for name in ("case", "model", "start", "fault", "window") if told[name])
        print(
            f"{k:4d} {own['verdict']:16} {own['error'] / references[key]:8.3g} {own['cpu_seconds']:6.1f} s  {words}"
            f"{'' if told['validated'] else ', not validated'}",
            file=sys.stderr, flush=True,
        )  # fmt: skip
        if asked.out:
            asked.out.write_text(json.dumps(whole(results, references), indent=1))
    print(json.dumps(summed(results, references), indent=1))


if __name__ == "__main__":
    main()
