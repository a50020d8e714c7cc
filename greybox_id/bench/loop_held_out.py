"""Drives that nobody learns from: by another driver, at the grip that adaptation knows and beyond."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..datasets.virtual_vehicle import SteppedCar, replay
from ..errors import GreyboxError
from ..loop.scene import Scene
from ..racing.track import RaceTrack, Usage, track
from ..racing.world import HALF_WIDTH, NARROWEST
from ..recording import Recording

RATE = 50.0
"""Commands a second, as drivers give them."""
SECONDS = 40.0
"""Of a held-out drive."""
LOOK = 0.22
"""s ahead to which this driver steers."""


def held_out(scene: Scene, share: float, seconds: float = SECONDS) -> Recording:
    """A drive at a share of the grip that the vehicle really has, read without noise: what is compared is models.

    Raises
    ------
    GreyboxError : the driver left the track.
    """
    size, p = scene.stated.size, scene.stated.parameters
    path = _track(scene, share)
    rows, per_acceleration = round(seconds * RATE), p["m"] / p["force_per_unit"]
    v_x = float(path.speed[0])
    ride = SteppedCar(scene.car, v_x, seconds + 1.0, RATE, scene.effects, scene.forms, scene.seed)
    commands, s = np.zeros((rows, 2)), 0.0
    for k in range(rows):
        now = ride.motion
        s, e_y, _ = path.project(now["x"], now["y"], now["yaw"], s)
        if abs(e_y) > 4.0 * path.half_width:
            raise GreyboxError(f"the driver left the track after {k / RATE:.0f} s at {share:.0%} of the grip")
        steer = _pursued(path, s, now, size.length)
        wanted = path.line("speed", np.array([s + 0.1 * now["v_x"]]))[0][0]
        a_x = np.clip((wanted - now["v_x"]) / (0.3 * size.time), -size.brake, size.drive)
        commands[k] = np.clip(steer, -scene.stated.steer_max, scene.stated.steer_max), a_x * per_acceleration
        ride.step(*commands[k])
    channels = {"steer": commands[:, 0], scene.stated.drive_channel: commands[:, 1]}
    plan = Recording(f"{share:.0%} of the grip", np.arange(rows) / RATE, channels)
    return replay(scene.car, plan, {"v_x": v_x}, scene.effects, scene.forms, scene.seed, noise=0.0)[0]


def _track(scene: Scene, share: float) -> RaceTrack:
    """The track, with speeds that use a share of what the vehicle really has."""
    size = scene.stated.size
    grip = share * scene.effects.get("grip_scale", 1.0)
    pulls = grip / scene.effects.get(
        "mass_change", 1.0
    )  # a payload presses on the tyres too, but no motor pulls harder
    use = Usage(grip * size.grip, pulls * size.drive, pulls * size.brake, size.top_speed)
    return track(NARROWEST * size.length, HALF_WIDTH * size.length, use)


def _pursued(path: RaceTrack, s: float, now: Mapping[str, float], wheelbase: float) -> float:
    """Steering, rad, of pure pursuit (Coulter 1992): along the circle to a point ahead on the path."""
    ahead = np.array([s + max(LOOK * now["v_x"], wheelbase)])
    x, y = (np.interp(ahead % path.length, path.s, own, period=path.length)[0] for own in (path.x, path.y))
    c, d = np.cos(now["yaw"]), np.sin(now["yaw"])
    along, across = c * (x - now["x"]) + d * (y - now["y"]), c * (y - now["y"]) - d * (x - now["x"])
    return float(np.arctan(2.0 * wheelbase * across / (along**2 + across**2)))
