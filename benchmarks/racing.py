"""How many steps of `greybox/Track-v0` a second of the processor makes, with observation, reward and new episodes.

python benchmarks/racing.py [--lanes 256] [--periods 1500] [--learned 500000] [--json]

Then the same with learning, end to end, in 64 lanes.
"""

from __future__ import annotations

import time

import numpy as np
from running import options, tell

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
    given = options(__doc__, lanes=256, periods=1500, learned=500_000)
    found = {}
    kinds = {"none": {}, "hand": {"randomise": "hand"}, "lidar": {"observation": "lidar", "noise": True}}
    for name, rules in kinds.items():
        own = world(given.lanes, action="speed", **rules)
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
    tell(found, given.json)


if __name__ == "__main__":
    main()
