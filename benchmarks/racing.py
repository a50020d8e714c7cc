"""How many steps of `greybox/Track-v0` a second of the processor makes, with observation, reward and new episodes.

python benchmarks/racing.py [--lanes 256] [--periods 1500] [--learned 500000] [--json]

Then the same with learning, end to end, in 64 lanes.
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np

from greybox_lab.driving.racing.learner import learn
from greybox_lab.driving.racing.world import OWN, World
from greybox_lab.driving.racing.worlds import world


def driven(own: World) -> np.ndarray:
    """Actions of a simple driver: along the curvature ahead, back to the line, at the speed that is wanted."""
    seen = own.observe()
    if own.rules.observation == "lidar":
        motion, commands = own.z[:, own._plane], seen[:, -2:]
        seen = own.seen(motion, own.z[:, -3:], commands)  # of what a lidar shows this driver makes nothing
    places, top = (seen.shape[1] - OWN) // 2, float(np.max(own.track.speed))
    steer = 0.35 * seen[:, OWN + 1] / own.track.half_width - 0.35 * seen[:, 3] - 0.8 * seen[:, 4]
    speed = 2 * (0.95 * top * seen[:, OWN + places + 2] - 0.5) / (top - 0.5) - 1
    return np.stack([steer / 0.419, speed], axis=1)


def main() -> None:
    """Run the benchmark."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--lanes", type=int, default=256)
    arguments.add_argument("--periods", type=int, default=1500)
    arguments.add_argument("--learned", type=int, default=500_000)
    arguments.add_argument("--json", action="store_true")
    given = arguments.parse_args()
    found = {}
    kinds = {"none": {}, "hand": {"randomise": "hand"}, "lidar": {"observation": "lidar", "noise": True}}
    for name, options in kinds.items():
        own = world(given.lanes, action="speed", **options)
        own.step(driven(own))
        periods = given.periods // 10 if name == "lidar" else given.periods
        clock, ended = time.process_time(), 0
        for _ in range(periods):
            _, over, cut = own.step(driven(own))
            ended += int(np.sum(over))
            if np.any(over | cut):
                own.reset(over | cut)
        seconds = time.process_time() - clock
        found[name] = {"steps_per_cpu_second": given.lanes * periods / seconds, "crashes": ended}
    own = world(64, randomise="hand", action="speed", reward="path", noise=True)
    clock = time.process_time()
    steps = learn(own, given.learned).policy.about["steps"]
    found["learning"] = {"steps_per_cpu_second": steps / (time.process_time() - clock)}
    if given.json:
        print(json.dumps(found))
        return
    for name, told in found.items():
        crashes = f", {told['crashes']} crashes" if "crashes" in told else ""
        print(f"{name:8} {told['steps_per_cpu_second']:9.0f} steps/CPU s{crashes}")


if __name__ == "__main__":
    main()
