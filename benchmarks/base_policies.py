"""The policies that are shipped: learned from a seed, and laps that they drive.

python benchmarks/base_policies.py [--vehicle roboracer] [--seed 0] [--steps 3000000] [--out FILE] [--json]

Two thirds of the steps are learned as anything is, the last third with the path weighing ten times as much, to which
nobody comes from nothing. Without --out it replaces what is shipped. The same seed gives the same bytes on the same
processor and libraries.
"""

from __future__ import annotations

import json
import time
from pathlib import Path

from running import options

from greybox_lab.driving import racing
from greybox_lab.driving.learn_policy import learn_policy
from greybox_lab.driving.loop.adapting import FOLLOW
from greybox_lab.driving.racing.laps import drive
from greybox_lab.driving.racing.worlds import world

FOLDER = Path(racing.__file__).parent / "policies"


def _said(sentence: str) -> None:
    print(sentence, flush=True)


def main() -> None:
    """Learn one, drive laps, write it."""
    given = options(__doc__, vehicle="roboracer", seed=0, steps=3_000_000, out={"type": Path})
    clock = time.process_time()
    last, how = given.steps // 3, {"seed": given.seed, "say": (lambda sentence: None) if given.json else _said}
    learned = learn_policy(given.vehicle, given.steps - last, **how)
    steps = learned.policy.about["steps"]
    learned = learn_policy(given.vehicle, last, start=learned, follow=FOLLOW, **how)
    seconds, steps = time.process_time() - clock, steps + learned.policy.about["steps"]
    found = {"steps": steps, "cpu_seconds": seconds, "steps_per_cpu_second": steps / seconds}
    for noise in (False, True):
        track = world(20, given.vehicle, action="speed", noise=noise)
        found["laps with noise" if noise else "laps"] = drive(track, learned.policy, 20, seed=1000).plain()
    learned.save(given.out or FOLDER / f"{given.vehicle}.json")
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
