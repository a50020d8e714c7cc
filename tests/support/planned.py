"""A plan driven by the virtual vehicle, which shares no code with the model it was designed with."""

import numpy as np

from greybox_lab.virtual.virtual_vehicle import SteppedCar, toleranced


def drive_plan(design, car, seed=5):
    """Path (n, 2) in the arena's axes, and the largest sideslip, rad, of a true car of other forms with the driver."""
    table, place = design.table(), design.placement
    rate = 1.0 / float(table["time"][1] - table["time"][0])
    true = toleranced(car, np.random.default_rng(seed))
    own = SteppedCar(true, float(table["v_x"][0]), design.duration + 1.0, round(rate), forms="other", seed=seed)
    c, s = np.cos(place.yaw), np.sin(place.yaw)
    path, sideslip = [], 0.0
    for row in table.rename(columns={design.drive: "drive"}).to_dict("records"):
        now = own.motion
        at = {
            "x": place.x + c * now["x"] - s * now["y"],
            "y": place.y + s * now["x"] + c * now["y"],
            "yaw": place.yaw + now["yaw"],
            "v_x": now["v_x"],
        }
        path.append((at["x"], at["y"]))
        sideslip = max(sideslip, abs(np.arctan2(now["v_y"], now["v_x"])))
        own.step(*design.driver.commands(row, at))
    return np.array(path), sideslip
