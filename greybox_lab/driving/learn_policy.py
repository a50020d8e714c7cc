"""Policies that drive an identified vehicle."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from greybox_id.api import given
from greybox_id.api.given import Effects, ModelLike, VehicleLike
from greybox_id.base.declared import understood
from greybox_id.base.errors import BadInput, must_be_whole

from .racing.draws import Randomisation
from .racing.learner import Learned, learn, load_learned
from .racing.world import World
from .racing.worlds import drivable, world

RULES = {"action": "speed", "reward": "path", "usage": (0.4, 0.95), "noise": True}
"""Of a track on which one policy learns to drive at any share of the grip."""
SAME = 1e-6
"""Share by which units may differ: rounding on another machine."""


@understood
def learn_policy(
    vehicle: VehicleLike = "roboracer",
    steps: int = 3_000_000,
    *,
    model: ModelLike = "single_track",
    effects: Effects = (),
    track: str | Path | None = None,
    half_width: float | None = None,
    randomise: Randomisation = "hand",
    start: Learned | str | Path | None = None,
    like: VehicleLike = None,
    lanes: int = 64,
    seed: int = 0,
    say: Callable[[str], None] | None = None,
    **rules: Any,
) -> Learned:
    """Learn to drive a vehicle, by proximal policy optimisation in its simulation.

    Parameters
    ----------
    vehicle : a shipped name, a vehicle file, or a `Vehicle`; its noise and largest steering angle are used.
    steps : periods of 20 ms over all lanes, filled up to whole rollouts.
    model : of motion; a name, or one at its values such as `gap.closed_model`.
    effects : that the model has besides, if it is named: "steering_delay=30ms".
    track : a CSV file of a closed middle line; None: a track scaled to the vehicle.
    half_width : m, of a track whose file states none.
    randomise : what differs from episode to episode: "none", "hand" (friction, mass, delay), draws, a fit or a gap.
    start : what was learned before and is to be tuned, or its file; None: from nothing.
    like : the vehicle that `start` was learned with, whose track and units stay; None: they are `vehicle`'s.
    lanes : vehicles side by side.
    seed : of everything that is drawn.
    say : called with sentences on how learning goes.
    rules : of the track, see `docs/racing.md`; by default wanted speeds, the reward `path`, 40 to 95 % of the grip and
        sensor noise.

    Returns
    -------
    Learned
        `policy`, what was learned, which `gb.export` takes; `save(path)` keeps it with what it takes to go on.

    Raises
    ------
    BadInput : there is no such vehicle, model, track or rule, or the start was learned with other units.

    Examples
    --------
    >>> from greybox_lab.driving.learn_policy import learn_policy
    >>> learned = learn_policy("roboracer", 500, lanes=4)
    >>> learned.policy.about["lanes"]
    4
    """
    must_be_whole(lanes, "lanes", 1)
    if start is not None and not isinstance(start, Learned | str | Path):
        raise BadInput(f"start: what learn_policy returned, or its file, is needed, not {start!r:.60}.")
    begun = load_learned(start) if isinstance(start, str | Path) else start
    value = given.vehicle(vehicle)
    driven = drivable(given.model(model, value, effects))
    units = None
    if like is not None:
        units = world(1, given.vehicle(like) or "roboracer", track=track, half_width=half_width)
    place = world(
        lanes, value or "roboracer", model=driven, track=track, half_width=half_width, randomise=randomise, like=units,
        **{**RULES, **rules},
    )  # fmt: skip
    if begun is not None:
        _same_units(begun, place)
    return learn(place, steps, start=begun, seed=seed, say=say or (lambda sentence: None))


def _same_units(start: Learned, place: World) -> None:
    """Raise `BadInput` where numbers of observations and actions would mean something else from now on."""
    held = start.policy.about.get("units", {})
    for name, unit in place.units.items():
        if name in held and abs(held[name] - unit) > SAME * unit:
            raise BadInput(
                f"start: the policy was learned with {held[name]:.6g} as the unit of {name}, but this track has the "
                f"unit {unit:.6g}. Name the "
                "vehicle it was learned with: like=."
            )
