"""Rules of driving on a track: what a driver sees, commands and is paid for, and when an episode ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from greybox_id.base.errors import BadInput, must_be_one_of, must_be_whole

USAGE = 0.8
"""Share of the grip, drive and brakes that the speed on the track asks for."""
ACTIONS, REWARDS = ("drive", "speed"), ("progress", "path", "cth")
OBSERVATIONS = ("track", "lidar")
MOST_MEMORY, REMEMBERED = 50, 3
"""Periods that drivers remember at most, a second; numbers of each: steering, yaw rate and v_x."""


@dataclass(frozen=True)
class Rules:
    """How a driver acts, is paid, and when an episode ends.

    Attributes
    ----------
    period : s, for which a command is held.
    action : "drive": the second action is the drive in its own unit, full brake to full drive; "speed": a wanted speed
        from 0.5 m/s to the track's top speed, whatever `speed_cap` is.
    reward : "progress": distance over that at the top speed, less what is beside the path, hasty or beyond the grip;
        "path": 1 less the share by which the speed along the path misses the wanted one, what is beside the path,
        hasty or beyond the grip, so that neither haste nor a shorter way is paid for;
        "cth": 0.2 v cos(e_psi) - 0.1 |e_y| - 0.5 |change of steering| - 0.5 (1 - wall / 0.3 m) + 0.01, a lap 10. A
        crash is -10 in all.
    observation : "track": motion, place and the track ahead; "lidar": ranges of 108 beams over 10 m, v_x, yaw rate and
        the last commands.
    memory : past periods of steering, yaw rate and v_x that are seen besides, the last one first.
    noise : whether v_x, v_y and yaw rate are seen with the vehicle's sensor noise, ranges with a lidar's.
    speed_cap : m/s; wanted speeds beyond are driven at it, and the speed that is seen of the track is at most that.
    follow : weight of what is beside the path in "path": with 10 a tenth of the half width costs as much as a tenth of
        the speed, with 100 a hundredth as much as a hundredth.
    usage_cap : share of the grip that the speed on the track may use; whatever is wanted, no faster is driven.
    usage : share of the grip that the speed that is seen of the track asks for, which scales that but not what an
        action means; a pair: drawn evenly between in each episode; None: `usage_cap`, or `USAGE` where there is none.
    seconds, laps : after which an episode is cut off.
    """

    period: float = 0.02
    action: str = "drive"
    reward: str = "progress"
    observation: str = "track"
    memory: int = 0
    noise: bool = False
    follow: float = 10.0
    speed_cap: float = np.inf
    usage_cap: float = np.inf
    usage: float | tuple[float, float] | None = None
    seconds: float = 30.0
    laps: int = 3

    def __post_init__(self) -> None:
        for name, known in (("action", ACTIONS), ("reward", REWARDS), ("observation", OBSERVATIONS)):
            must_be_one_of(known, getattr(self, name), f"There is no {name}")
        must_be_whole(self.memory, "memory", 0, MOST_MEMORY)
        for name in ("period", "follow", "speed_cap", "usage_cap", "seconds", "laps"):
            if not getattr(self, name) > 0:
                raise BadInput(f"{name}: a number above zero is needed, not {getattr(self, name)!r}.")
        shares = np.ravel(USAGE if self.usage is None else self.usage)
        if shares.dtype.kind not in "fi" or not (len(shares) in (1, 2) and 0 < shares[0] <= shares[-1] <= 1):
            raise BadInput(f"usage: a share of the grip from 0 to 1, or two of them, is needed, not {self.usage!r}.")

    @property
    def shares(self) -> tuple[float, float]:
        """Smallest and largest share of the grip that is asked for."""
        if self.usage is None:
            result = np.array([self.usage_cap if np.isfinite(self.usage_cap) else USAGE])
        else:
            result = np.minimum(np.ravel(self.usage), self.usage_cap)
        return float(result[0]), float(result[-1])
