"""Which model does the controller drive best with: the vehicle file, a network, what was named, or the truth?

    greybox bench loop --quick --out black_box --case 0 --case 1
    python examples/nmpc/arms.py --bench black_box --case 0 --case 1

Beside `greybox bench loop`, whose drivers learn: the same vehicles and rows of the same driver, but a controller that
learns nothing, so that nothing hangs on how well it was learned. It drives a lap at 90 % of the grip there is.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import scene as nmpc
from controller import Controller
from lap import lap
from learned import LearnedPrediction
from prediction import Prediction

from greybox_id.base.files import write_atomically
from greybox_id.models.registry import motion_model_of
from greybox_lab.driving.learned.injection import InjectedModel
from greybox_lab.driving.loop.adapting import last_rows, world_of
from greybox_lab.driving.loop.arms import oracle, twin
from greybox_lab.driving.loop.scene import Hands, Scene, driven
from greybox_lab.driving.loop.swap import read_learned
from greybox_lab.papers.loop import CAPS, FIRST_VEHICLE

ARMS = ("nominal", "actuator_net", "residual", "named", "oracle")


class Believed(nmpc.Scene):
    """A vehicle of the comparison, on the track and with the wishes of this example."""

    def __init__(self, own: Scene) -> None:
        super().__init__({}, own.forms)
        self.__dict__ |= {"stated": own.stated, "car": own.car, "effects": own.effects}


def main() -> None:
    """Drive all arms of the cases, print what came of it, and write it down."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--bench", type=Path, required=True, help="folder of greybox bench loop, of whose drivers rows are"
    )
    parser.add_argument("--case", type=int, action="append", required=True, help="as of greybox bench loop")
    parser.add_argument("--vehicle", type=int, default=FIRST_VEHICLE, help="as of greybox bench loop")
    parser.add_argument("--rows", type=int, default=5_000, help="that models are made of")
    parser.add_argument("--until", type=float, default=float("inf"), help="m along the track, where a lap is too long")
    parser.add_argument("--arm", action="append", choices=ARMS, help="those that are driven, all unless said")
    asked = parser.parse_args()
    found = []
    for number in asked.case:
        forms = ("nominal", "other")[(number + asked.vehicle - FIRST_VEHICLE) % 2]
        own = Scene(number, asked.vehicle, forms, exact=forms == "nominal")
        folder = asked.bench / f"case_{number}_vehicle_{asked.vehicle}_seed_0"
        driver = read_learned((folder / "driver.json").read_bytes(), folder)
        units = world_of(motion_model_of(own.vehicle), own.vehicle, 1, CAPS[0])
        rows = last_rows(driven(own, Hands(units, driver.policy.act), asked.rows, 0).recordings, asked.rows)
        believed = Believed(own)
        track, wishes = believed.track, believed.wishes
        for arm in asked.arm or ARMS:
            known = oracle(own.vehicle, own.effects) if arm == "oracle" else twin(arm, own.vehicle, rows)
            assert known is not None
            kind = LearnedPrediction if isinstance(known.model, InjectedModel) else Prediction
            controller = Controller(kind(known.model, nmpc.PERIOD, wishes.units), track, wishes, float(track.speed[0]))
            done = lap(own.car, own.effects, own.forms, own.seed, track, controller, nmpc.PERIOD, asked.until)
            found.append({"case": number, "forms": forms, "arm": arm, "path_error_rms": done.rms,
                          "path_error_p95": done.p95, "lap_time": done.time, "finished": done.finished,
                          "driven": float(done.s[-1]), "not_solved": done.failures,
                          "solve": done.solve[0], "applied": dict(known.applied)})  # fmt: skip
            told = f"lap {done.time:.2f} s" if done.finished else f"lost after {done.s[-1]:.0f} m"
            print(f"case {number}  {arm:12}  path error {1e3 * done.rms:.1f} mm, 95 % {1e3 * done.p95:.1f} mm, {told}, "
                  f"{1e3 * done.solve[0]:.1f} ms a decision, {done.failures} not solved", flush=True)  # fmt: skip
    print(f"written  {write_atomically(asked.bench / 'nmpc.json', json.dumps(found, indent=1))}")


if __name__ == "__main__":
    main()
