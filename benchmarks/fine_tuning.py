"""How far fine-tuning gets with vehicles that the shipped policy does not know: settings side by side.

python benchmarks/fine_tuning.py [--steps 300000] [--laps 20] [--seed 7]

A policy that crashes on them is tuned in their own model, then both drive laps of it.
"""

from __future__ import annotations

import time

import pandas as pd
from running import options

from greybox_lab.driving.racing.laps import drive
from greybox_lab.driving.racing.learner import FINE_TUNING, Settings, learn, shipped_learned
from greybox_lab.driving.racing.world import World
from greybox_lab.driving.racing.worlds import world

VEHICLES = (
    {"grip_scale": 0.8, "steering_delay": 0.06, "steering_lag": 0.08, "steering_ratio": 1.1},
    {"grip_scale": 0.9, "steering_delay": 0.04, "steering_lag": 0.04, "steering_ratio": 1.0},
)
NULLS = ("grip_scale=1", "steering_delay=1e-6", "steering_lag=1e-6", "steering_ratio=1")
"""The effects next to nothing: units and the track stay those of the nominal vehicle, draws set what it has."""
ARMS = {
    "published": Settings(rate=1e-4, kl_stop=0.02, sd=0.03),
    "published, sd of 0.1 and more": Settings(rate=1e-4, kl_stop=0.02, sd=0.1, least_sd=0.1),
    "default": FINE_TUNING,
}
USES = (0.6, 0.8, 0.9)


def of(vehicle: dict[str, float], lanes: int, usage: float | tuple[float, float], **rules: object) -> World:
    """The world of a vehicle with effects, in the units of the nominal one."""
    drawn = pd.DataFrame({name: [value] for name, value in vehicle.items()})
    return world(lanes, effects=NULLS, randomise=drawn, action="speed", usage=usage, **rules)


def main() -> None:
    """Tune with each of the settings, drive laps, print a table."""
    given = options(__doc__, steps=300_000, laps=20, seed=7)
    base = shipped_learned()
    for vehicle in VEHICLES:
        print(", ".join(f"{name} {value}" for name, value in vehicle.items()))
        for name, settings in {"base": None, **ARMS}.items():
            clock, learned = time.process_time(), base
            if settings is not None:
                tuned_in = of(vehicle, 64, (0.5, 0.95), reward="path", noise=True)
                learned = learn(tuned_in, given.steps, start=base, settings=settings, seed=given.seed)
            seconds = time.process_time() - clock
            for usage in USES:
                own = drive(of(vehicle, 20, usage), learned.policy, given.laps, seed=99)
                print(
                    f"  {name:30} {usage:.0%} of the grip: {len(own.lap_times):3} of {own.tried} laps, "
                    f"{own.lap_time:6.2f} s, path error {own.path_error_rms:.3f} m rms, {seconds:5.1f} CPU s",
                    flush=True,
                )


if __name__ == "__main__":
    main()
