"""What designed manoeuvres tell, driven by cars that share no code with the model they were designed with.

    python benchmarks/design.py precision --vehicles 20 --seed 9000 --out design_precision.jsonl
    python benchmarks/design.py aliases
    python benchmarks/design.py separation --vehicles 80 --seed 9500 --out design_separation.jsonl
    python benchmarks/design.py report design_precision.jsonl

precision: a vehicle of the virtual garage, true one within its tolerances, other functional forms of tyres and all
else, coloured noise. A first drive of 20 s (mixed) is fitted: the five parameters, of which nothing is believed, all
that the vehicle's file states with a tolerance, and the error of the equations' form (form=uncertain); a manoeuvre is
designed from that fit and driven by `SteppedCar` with the plan's driver, and once more in open loop; what its sensors
read is fitted alone. Beside it, of equal duration: another mixed drive, whose extent is the arena of the design, and
every standard manoeuvre of the virtual vehicle on an endless plane. What is true of a tyre of another form are the B
and D of the magic formula that comes nearest to its curve, as `models.form` defines them. "exact" is of fits that take
equations for exact. The designed and the mixed drive are diagnosed as well: nothing is the matter with these vehicles.
separation: a vehicle with one effect, of those that show on a straight, accelerates for 5 s; where the
diagnosis of that leaves names that are not told apart, up to 10 s are driven beside it: a manoeuvre designed for them,
what fixed advice comes nearest to, or a mixed one; the diagnosis of both recordings says which name comes first.
One JSON line a vehicle; a run that was stopped goes on behind the last line.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.optimize import least_squares

import greybox_id as gb
from greybox_id.gap.advice import to_drive
from greybox_id.gap.design.discriminate import ambiguous, distinguishable_effects
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import build
from greybox_id.models.vehicles import with_tolerances
from greybox_lab.exam.aliases import ALWAYS_ALIKE, always_alike
from greybox_lab.virtual.virtual_vehicle import (
    Forms,
    SteppedCar,
    VirtualCar,
    drive,
    random_vehicle,
    replay,
    toleranced,
    tolerances,
    vehicle_file_text,
)
from greybox_lab.virtual.virtual_vehicle.drive import made
from greybox_lab.virtual.virtual_vehicle.effects import complete
from greybox_lab.virtual.virtual_vehicle.manoeuvres import PIECES
from greybox_lab.virtual.virtual_vehicle.record import record
from greybox_lab.virtual.virtual_vehicle.tyres import curve

NAMES = ("I_z", "B_f", "D_f", "B_r", "D_r")
DURATION, RATE, COLOUR = 20.0, 50.0, 0.3
GRIP = 1.0
"""Share of the friction that may be used: all of it, as mixed and standard drives do."""
NONE: Mapping[str, float] = MappingProxyType({})
ALONE, MORE = 5.0, 10.0
"""s of the first recording of a separation, of the second."""
EFFORT = 0.15
"""Of the search of a separation, over what is usual: so that forty of them take a quarter of an hour."""
ON_A_STRAIGHT = ("acceleration",)
"""First recordings of a separation: of all standard manoeuvres, one in ten leaves names open; coasting hardly any."""
SHOWN = ("aero_drag", "rolling_resistance", "wind_gust", "motor_gain", "mass_change")
"""Effects that show there and can be taken for others: half of them are left open, of all others few."""
ADVISED = {"step": "steps", "sweep": "slalom", "full braking": "acceleration", "spiral": "laps", "circles": "laps",
           "straight": "coast_down"}  # fmt: skip
"""Words of a diagnosis' fixed advice -> the standard manoeuvre that comes nearest; else mixed."""
WITHIN = 1.96
"""Standard deviations within which 95 % lie."""
SLIPS = np.linspace(0.0, 1.0, 4001)
"""Slip angles, rad, at which a curve is looked at."""
SPIN = 0.5
"""Sideslip, rad, from which on a car counts as spun."""


def cpu_seconds() -> float:
    """Of this process and of compilers that it called."""
    return sum(os.times()[:4])


def stated(car: VirtualCar) -> gb.Vehicle:
    """The vehicle with its tolerances, nothing but a value of the five."""
    known = tolerances(car)
    sd = {name: own for name, own in known.parameters.items() if name not in NAMES}
    values = {name: gb.models.Stated(value, sd=sd.get(name)) for name, value in car.parameters.items()}
    return gb.Vehicle(
        car.name, values=values, effects={n: gb.models.Stated(sd=own) for n, own in known.effects.items()}
    )


def fitted(car: VirtualCar, recordings: Any, *, form: str = "uncertain") -> Any:
    """The five parameters, all else within its tolerance."""
    vehicle = stated(car)
    model = build("single_track", {"form": form}, {}, vehicle=vehicle)
    gauss_newton = gb.FitOptions(solver="gauss-newton")  # Ipopt goes on by 1e-5 at kinks of delays and confirms nothing
    return gb.fit(with_tolerances(model, vehicle, EFFECTS), recordings, options=gauss_newton)


def driven(
    true: VirtualCar, forms: Forms, design: Any, seed: int, *, follow: bool, effects: Mapping[str, float] = NONE
) -> tuple[Any, dict[str, float]]:
    """A plan driven by another car: the recording, and how close it came to limits."""
    table = design.table()
    plan = {name: table[name].to_numpy() for name in ("steer", design.drive, "v_x", "x", "y", "yaw")}
    car = SteppedCar(true, float(plan["v_x"][0]), DURATION + 1.0, RATE, forms=forms, effects=effects, seed=seed)
    c, s = np.cos(design.placement.yaw), np.sin(design.placement.yaw)
    commands, path, slip = [], [], []
    for k in range(len(table)):
        now = car.motion
        at = {
            "x": design.placement.x + c * now["x"] - s * now["y"],
            "y": design.placement.y + s * now["x"] + c * now["y"],
            "yaw": now["yaw"] + design.placement.yaw, "v_x": now["v_x"],
        }  # fmt: skip
        row = {name: float(values[k]) for name, values in plan.items()} | {"drive": float(plan[design.drive][k])}
        steer, force = design.driver.commands(row, at) if follow else (row["steer"], row["drive"])
        path.append((at["x"], at["y"]))
        slip.append(abs(np.arctan2(now["v_y"], max(now["v_x"], 0.1))))
        commands.append((steer, force))
        car.step(steer, force)
    truth, xy = car.truth(), np.array(path)
    steer, force = np.array(commands).T
    start = {"v_x": float(plan["v_x"][0])}
    asked = gb.Recording("designed", table["time"].to_numpy(), {"steer": steer, design.drive: force})
    recording, _ = replay(true, asked, start, forms=forms, effects=effects, seed=seed, noise=1.0, colour=COLOUR)
    wheels = [name for name in truth if name.startswith("alpha")]
    return recording, {
        "outside": float(design.arena.outside(xy[:, 0], xy[:, 1])),
        "off_path": float(np.max(np.hypot(xy[:, 0] - plan["x"], xy[:, 1] - plan["y"]))),
        "sideslip": float(np.max(slip)),
        "slip_angle": float(np.max(np.abs([truth[name] for name in wheels]))) if wheels else 0.0,
        "use": _use(true, truth),
    }


def _use(true: VirtualCar, truth: Any) -> float:
    """Largest share of an axle's stated friction that was used: force over D times load, of both wheels together."""
    shares = []
    for axle in "fr":
        along, across, load = (sum(truth[f"{what}_{axle}{side}"] for side in "lr") for what in ("F_x", "F_y", "F_z"))
        shares.append(np.max(np.hypot(along, across) / np.maximum(true.parameters[f"D_{axle}"] * load, 1e-6)))
    return float(max(shares))


def truth_of(true: VirtualCar, forms: Forms) -> dict[str, float]:
    """The five of a car: of its tyres, those of the magic formula that comes nearest to their own curve.

    With the C and E that the car has, where every share of the friction counts alike (`models.form`).
    """
    own, found = record(true, complete(true.small, true.size), forms), {"I_z": float(true.parameters["I_z"])}
    for axle in "fr":
        B, C, D, E = (true.parameters[f"{letter}_{axle}"] for letter in "BCDE")
        shares = np.array([curve(own, axle == "f", alpha, 1.0) for alpha in SLIPS])
        top = int(np.argmax(shares))
        slips = np.interp((np.arange(200) + 0.5) / 200 * shares[top], shares[: top + 1], SLIPS[: top + 1])
        aim = np.interp(slips, SLIPS, shares)

        def off(x: Any, C: float = C, E: float = E, slips: Any = slips, aim: Any = aim) -> Any:
            slip = x[0] * slips
            return x[1] * np.sin(C * np.arctan(slip - E * (slip - np.arctan(slip)))) - aim

        nearest = least_squares(off, [B, 1.0], x_scale=[B, 1.0]).x
        found |= {f"B_{axle}": float(nearest[0]), f"D_{axle}": float(nearest[1] * D)}
    return found


def told(fit: Any, truth: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Estimate, standard deviation, interval and truth of the five."""
    found = {}
    for name in NAMES:
        low, high = fit.interval(name)
        found[name] = {
            "value": float(fit.model[name].array), "sd": float(fit.sd[name]), "low": float(low), "high": float(high),
            "true": truth[name],
        }  # fmt: skip
    return found


def named(car: VirtualCar, recording: Any) -> list[str]:
    """What a diagnosis with the vehicle's file names as missing; "unknown" where it is sure of a gap but of no name."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "car.toml"
        file.write_text(vehicle_file_text(car, tolerances(car)), encoding="utf-8")
        gap = gb.diagnose("single_track", recording, vehicle=file)
    return (list(gap.applied) or ["unknown"]) if gap.gap_detected else []


def precision(seed: int, effort: float, *, quick: bool) -> dict[str, Any]:
    """One vehicle; quickly: of the other drives only mixed, nothing of fits that take equations for exact."""
    car = random_vehicle(seed)
    true = toleranced(car, np.random.default_rng((seed, 5)))
    forms = made(true, NONE, "other", seed, RATE).forms  # one car: all its drives have them
    truth = truth_of(true, forms)
    options = {"duration": DURATION, "rate": RATE, "forms": forms, "colour": COLOUR}
    first, _ = drive(true, "mixed", seed=seed, **options)
    pilot = fitted(car, first)
    other, driven_path = drive(true, "mixed", seed=seed + 50_000, **options)
    x, y = (driven_path.states[name] for name in "xy")
    radius = 0.5 * float(np.hypot(np.ptp(x), np.ptp(y)))  # the arena that the other mixed drive takes
    began = cpu_seconds()
    design = gb.design(
        pilot, "precision", arena=f"disc:{radius:.2f}", parameters=NAMES, duration=DURATION,
        rate=RATE, speed_max=car.top_speed, grip=GRIP, seed=seed, effort=effort,
        limits={"steer_max": car.steer_max, "drive_max": car.size.drive, "brake_max": car.size.brake},
    )  # fmt: skip
    seconds = cpu_seconds() - began
    recording, limits = driven(true, forms, design, seed + 100_000, follow=True)
    _, open_loop = driven(true, forms, design, seed + 100_000, follow=False)
    result: dict[str, Any] = {
        "seed": seed, "car": car.name, "cpu_seconds": seconds, "kept": design.kept, "radius": radius,
        "sentence": design.sentence,
        "predicted": {name: list(own) for name, own in design.predicted_sd.items()},
        "limits": limits, "open_loop": open_loop, "active": list(design.active_limits),
        "forms": vars(forms), "pilot": told(pilot, truth), "designed": told(fitted(car, recording), truth),
        "both": told(fitted(car, [first, recording]), truth),
        "named": {"designed": named(car, recording)},
        "standard": {},
    }  # fmt: skip
    if not quick:
        result |= {
            "designed_exact": told(fitted(car, recording, form="exact"), truth),
            "mixed_exact": told(fitted(car, other, form="exact"), truth),
            "mixed_both": told(fitted(car, [first, other]), truth),
        }
        result["named"]["mixed"] = named(car, other)
    for name in ("mixed",) if quick else ("mixed", *PIECES):
        try:
            own, _ = drive(true, name, seed=seed + 50_000, **options)
            result["standard"][name] = told(fitted(car, own), truth)
        except gb.GreyboxError as error:
            result["standard"][name] = str(error)
    return result


def separation(seed: int, effort: float) -> dict[str, Any]:
    """One case: an effect, one standard manoeuvre; three ways to go on if that leaves names that are not told apart."""
    car, rng = random_vehicle(seed), np.random.default_rng((seed, 23))
    true = toleranced(car, np.random.default_rng((seed, 5)))
    effect, manoeuvre = str(rng.choice(SHOWN)), str(rng.choice(ON_A_STRAIGHT))
    effects = {effect: car.magnitude(effect, rng)}
    forms = made(true, NONE, "other", seed, RATE).forms
    options = {"rate": RATE, "effects": effects, "forms": forms, "colour": COLOUR}
    found: dict[str, Any] = {"seed": seed, "car": car.name, "true": effect, "first": manoeuvre}
    first, truth = drive(true, manoeuvre, seed=seed, duration=ALONE, **options)
    effects |= {name: own for name, own in truth.effects.items() if name == "wind_direction"}  # it blows on
    options["effects"] = effects
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "car.toml"
        file.write_text(vehicle_file_text(car, tolerances(car)), encoding="utf-8")
        gap = gb.diagnose("single_track", first, vehicle=file)
        names, _ = distinguishable_effects(ambiguous(gap))
        if len(names) < 2:
            return found | {"open": list(names)}
        began = cpu_seconds()
        design = gb.design(
            gap, "discriminate", arena=f"disc:{30.0 * car.size.length:.1f}", duration=MORE, rate=RATE, grip=GRIP,
            speed_max=car.top_speed, seed=seed, effort=effort,
            limits={"steer_max": car.steer_max, "drive_max": car.size.drive, "brake_max": car.size.brake},
        )  # fmt: skip
        found |= {
            "open": list(names), "p": {own.effect: own.probability for own in gap.ranking if own.effect in names},
            "cpu_seconds": cpu_seconds() - began, "impossible": list(design.impossible),
            "sentence": design.sentence,
        }  # fmt: skip
        if not design.phases:
            return found
        found["separation"] = [[list(own.pair), own.nats, own.p10] for own in design.separation]
        words = to_drive(names, EFFECTS)
        advised = next((own for word, own in ADVISED.items() if word in words), "mixed")
        second, found["limits"] = driven(true, forms, design, seed + 100_000, follow=True, effects=effects)
        ways = {"design": second}
        for way, name in (("mixed", "mixed"), ("advice", advised)):
            ways[way] = drive(true, name, seed=seed + 50_000 + len(ways), duration=design.duration, **options)[0]
        found["advised"] = advised
        for way, own in ways.items():
            both = gb.diagnose("single_track", [first, own], vehicle=file)
            found[way] = [
                [o.effect, o.probability, o.gain, list(o.indistinguishable_from)] for o in both.ranking
            ]  # fmt: skip
    return found


def separated(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """The figures of separation."""
    from scipy.stats import binomtest, spearmanr

    done = [own for own in lines if "advice" in own]
    true = [{own["true"], *always_alike(own["true"])} for own in done]
    right = {
        way: np.array([bool(own[way]) and own[way][0][0] in names for own, names in zip(done, true, strict=True)])
        for way in ("design", "advice", "mixed")
    }
    alone = {
        way: ok & np.array([not set(own[way][0][3]) - names for own, names in zip(done, true, strict=True)])
        for way, ok in right.items()
    }
    better = {way: [int(np.sum(right["design"] & ~right[way])), int(np.sum(~right["design"] & right[way]))]
              for way in ("advice", "mixed")}  # fmt: skip
    expected, achieved = [], []
    for own in done:
        gains = {name: gain for name, _, gain, _ in own["design"]}
        for pair, nats, _ in own["separation"]:
            if own["true"] in pair and own["true"] in gains:
                other = pair[1] if pair[0] == own["true"] else pair[0]
                if other in gains:
                    expected.append(nats)
                    achieved.append(gains[own["true"]] - gains[other])
    ratio = np.array(achieved) / np.maximum(expected, 1e-9) if expected else np.array([np.nan])
    return {
        "cases": len(lines), "open": len(done), "failed": [own for own in lines if "error" in own],
        "true_among_open": int(sum(own["true"] in own["open"] for own in done)),
        "true_first": {way: float(np.mean(own)) for way, own in right.items()},
        "true_first_and_alone": {way: float(np.mean(own)) for way, own in alone.items()},
        "only_design_only_other": better,
        "mcnemar_p": {way: float(binomtest(a, a + b).pvalue) if a + b else 1.0 for way, (a, b) in better.items()},
        "achieved_over_predicted_median": float(np.median(ratio)), "pairs": len(expected),
        "rank_correlation": float(spearmanr(expected, achieved)[0]) if len(expected) > 2 else None,
        "left_arena": int(sum(own["limits"]["outside"] > 0 for own in done)),
        "spun": int(sum(own["limits"]["sideslip"] > SPIN for own in done)),
        "beyond_grip": int(sum(own["limits"]["use"] > 1.0 for own in done)),
        "cpu_seconds_most": max((own["cpu_seconds"] for own in done), default=0.0),
    }  # fmt: skip


def report(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """The figures."""
    done = [own for own in lines if "designed" in own]

    def width(of: Any) -> float:
        """Geometric mean of relative widths; NaN where there was no fit, or none whose optimum was confirmed."""
        if isinstance(of, str) or of is None:
            return np.nan
        return float(
            np.exp(np.mean([np.log(max(own["high"] - own["low"], 1e-12) / own["true"]) for own in of.values()]))
        )

    def widths(*way: str) -> Any:
        return np.array([width(own[way[0]] if len(way) == 1 else own[way[0]].get(way[1])) for own in done])

    def over(one: Any, other: Any) -> list[float]:
        """Geometric mean of a ratio, its relative standard error over vehicles, and how many there are."""
        there = np.isfinite(one) & np.isfinite(other)
        logs = np.log(one[there] / other[there])
        if len(logs) < 2:
            return []
        return [float(np.exp(np.mean(logs))), float(np.std(logs, ddof=1) / np.sqrt(len(logs))), len(logs)]

    designed, mixed = widths("designed"), widths("standard", "mixed")
    whole = all("mixed_both" in own for own in done)
    each = np.array([widths("standard", name) for name in PIECES])
    best = np.min(np.where(np.isfinite(each), each, np.inf), axis=0, initial=np.inf)
    ratio = [
        own["predicted"][name][1] / own["both"][name]["sd"]
        for own in done
        for name in NAMES
        if own["both"][name]["sd"] > 0
    ]

    def coverage(of: list[Any]) -> list[float]:
        """Share of intervals that hold what is true, its standard error over vehicles, and how many vehicles."""
        fits = [[v for v in own.values() if np.isfinite(v["sd"])] for own in of if isinstance(own, dict)]
        each = [np.mean([v["low"] <= v["true"] <= v["high"] for v in own]) for own in fits if own]
        if len(each) < 2:
            return []
        return [float(np.mean(each)), float(np.std(each, ddof=1) / np.sqrt(len(each))), len(each)]

    expected = [  # of the estimate from both recordings, with the standard deviation that was predicted
        abs(own["both"][name]["value"] - own["both"][name]["true"]) <= WITHIN * own["predicted"][name][1]
        for own in done for name in NAMES
    ]  # fmt: skip
    return {
        "vehicles": len(done), "failed": [own for own in lines if "designed" not in own],
        "width_over_mixed": over(designed, mixed),
        "width_over_best_standard": over(designed, best),
        "width_over_mixed_beside_the_first": over(widths("both"), widths("mixed_both")) if whole else [],
        "narrower_than_mixed": int(np.sum(designed < mixed)),
        "predicted_over_achieved_sd_median": float(np.median(ratio)),
        "predicted_over_achieved_sd_quartiles": np.quantile(ratio, [0.25, 0.75]).tolist(),
        "coverage_predicted": float(np.mean(expected)),
        **{f"coverage_{kind}": coverage([own.get(kind) for own in done])
           for kind in ("pilot", "designed", "both", "designed_exact", "mixed_exact", "mixed_both")},
        "coverage_mixed": coverage([own["standard"]["mixed"] for own in done]),
        "coverage_of_each": {
            name: coverage([{name: own["designed"][name]} for own in done]) for name in NAMES
        },
        "left_arena_driver": int(sum(own["limits"]["outside"] > 0 for own in done)),
        "left_arena_open_loop": int(sum(own["open_loop"]["outside"] > 0 for own in done)),
        "spun": int(sum(own["limits"]["sideslip"] > SPIN for own in done)),
        "largest_use": float(max(own["limits"]["use"] for own in done)),
        "beyond_grip": int(sum(own["limits"]["use"] > 1.0 for own in done)),
        "false_alarms": {
            way: [sum(bool(own["named"][way]) for own in told), len(told)]
            for way in ("designed", "mixed")
            if (told := [own for own in done if way in own.get("named", {})])
        },
        "cpu_seconds_median": float(np.median([own["cpu_seconds"] for own in done])),
        "cpu_seconds_most": float(max(own["cpu_seconds"] for own in done)),
    }  # fmt: skip


def aliases() -> dict[str, Any]:
    """Whether every pair that always reads the same is called impossible."""
    found = {" ".join(pair): [list(own) for own in distinguishable_effects(pair)[1]] for pair in ALWAYS_ALIKE}
    return {"pairs": len(found), "called_impossible": sum(len(own) == 1 for own in found.values())}


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["precision", "separation", "aliases", "report"])
    parser.add_argument("file", nargs="?", help="of report")
    parser.add_argument("--vehicles", type=int, default=20)
    parser.add_argument("--seed", type=int, default=9000)
    parser.add_argument("--quick", action="store_true", help="precision: beside the design, mixed alone")
    parser.add_argument("--effort", type=float, help="of the search; 1 of precision, 0.15 of separation")
    parser.add_argument("--out", help="design_WHAT.jsonl unless named")
    given = parser.parse_args()
    if given.what == "aliases":
        sys.stdout.write(json.dumps(aliases(), indent=1) + "\n")
        return 0
    if given.what == "report":
        lines = [json.loads(line) for line in Path(given.file).read_text().splitlines()]
        figures = separated(lines) if any("open" in own for own in lines) else report(lines)
        sys.stdout.write(json.dumps(figures, indent=1) + "\n")
        return 0
    out = Path(given.out or f"design_{given.what}.jsonl")
    there = {json.loads(line)["seed"] for line in out.read_text().splitlines()} if out.exists() else set()
    for seed in range(given.seed, given.seed + given.vehicles):
        if seed in there:
            continue
        try:
            found = (
                precision(seed, given.effort or 1.0, quick=given.quick)
                if given.what == "precision"
                else separation(seed, given.effort or EFFORT)
            )
        except gb.GreyboxError as error:
            found = {"seed": seed, "error": str(error)}
        with out.open("a") as opened:
            opened.write(json.dumps(found) + "\n")
        sys.stdout.write(f"{seed}: {found.get('sentence', found.get('error', found.get('open')))}\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
