"""Training actuator networks on recordings: next step by next step, as published, held out by blocks of time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from greybox_id.base.errors import BadInput, near_or_all
from greybox_id.base.shorthands import Array, Say
from greybox_id.base.signals import DRIVE_SIGNALS
from greybox_id.datasets.recording import Recording
from greybox_id.engine.solvers.quasi_newton import Descent, descend
from greybox_id.models.motion_model import MotionModel

from ..racing.stage import PLANE
from .injection import fingerprint
from .net import DRIVE, HIDDEN, VARIANTS, ActuatorNet, SquaredError, Variant, drawn
from .open_loop import OpenLoop
from .windows import HELD_OUT, StepWindows, data_hash, resampled, windows

ADAM, STEPS, PATIENCE = 100, 300, 40
"""Steps of Adam from random weights; of L-BFGS after them (as many as were published epochs); without a better
held-out error until it ends."""
_SAID = 20


def train_actuator_net(
    recordings: Recording | Sequence[Recording],
    *,
    variant: str = "paper",
    model: MotionModel | None = None,
    sample_time: float | None = None,
    seed: int = 0,
    members: int = 1,
    steps: int = STEPS,
    say: Say = lambda line: None,
) -> ActuatorNet:
    """Train networks that say a vehicle's next yaw rate.

    Every member draws its weights and a tenth of the blocks of 2 s, which is held out and says when it is trained; Adam
    and then L-BFGS lower the mean squared error of standardised outputs on the others.

    Parameters
    ----------
    recordings : steer, yaw_rate and v_x; but for `paper` also v_y and the drive's command.
    variant : "paper": three steps of steer, yaw rate and v_x say the next yaw rate; "abstract": fifteen steps of
        commands and motion say yaw rate and v_y; "residual": the same, as the difference to a model.
    model : of motion, that `residual` adds to.
    sample_time : s, between steps; None: that of the first recording. Recordings of others are resampled, and the
        network says so (`trained["notes"]`).
    seed : of the first member; the others have the seeds that follow.
    members : networks.
    steps : of L-BFGS, at most.
    say : told a line at a time.

    Raises
    ------
    BadInput : a signal is missing, holds too little, or is constant; there is no such variant; a model is missing, or
        given to a variant that adds to none.

    Examples
    --------
    >>> import greybox_id as gb
    >>> from greybox_lab.driving.learned.training import train_actuator_net
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> net = train_actuator_net(lap, steps=3)
    >>> net.inputs, net.outputs, net.history
    (('steer', 'yaw_rate', 'v_x'), ('yaw_rate',), 3)
    """
    given = [recordings] if isinstance(recordings, Recording) else list(recordings)
    value, channel = _checked(given, variant, model)
    if members < 1 or steps < 1:
        raise BadInput(f"members and steps are 1 or more, not {members} and {steps}.")
    step = round(given[0].sample_time, 9) if sample_time is None else float(sample_time)
    if not step > 0:
        raise BadInput(f"sample_time: seconds above zero are needed, not {sample_time!r}.")
    even = [resampled(recording, step) for recording in given]
    known = [_foretold(model, recording, value.outputs) for recording in even]
    result = windows(even, value, channel, step, known)
    means, scales, out_means, out_scales = _scales(result, value.outputs, value.residual)
    x = ((result.seen - means) / scales).reshape(len(result), -1)
    y = (result.following - result.own - out_means) / out_scales
    sizes = (x.shape[1], *HIDDEN, y.shape[1])
    trained, errors = [], []
    for k in range(members):
        rng = np.random.default_rng(seed + k)
        inside, outside = result.split(rng)
        if not (np.any(inside) and np.any(outside)):
            raise BadInput(
                f"{len(result)} windows in {result.blocks.max() + 1} blocks of time are too few to train on some and "
                "hold others out. Record longer, without gaps."
            )
        net = drawn(sizes, rng)
        held = SquaredError(net, x[outside], y[outside])
        done = _descended(SquaredError(net, x[inside], y[inside]), held, net.vector, steps, seed + k, say)
        trained.append((net.at(done.x), done, int(np.sum(inside)), int(np.sum(outside))))
        errors.append(held.errors(done.x) * out_scales)
        if done.status == "interrupted":
            raise KeyboardInterrupt
    about: dict[str, Any] = {
        "recordings": [recording.name for recording in given],
        "rows": int(sum(len(recording) for recording in even)),
        "held_out": HELD_OUT,
        "members": [
            {"seed": seed + k, "windows": inside, "held_out_windows": outside, "steps": done.best,
             "status": done.status, "error": done.held_out[done.best]}
            for k, (_, done, inside, outside) in enumerate(trained)
        ],
        "notes": [note for recording in even for note in recording.notes if "resampled" in note],
    }  # fmt: skip
    return ActuatorNet(
        variant=variant, inputs=value.inputs, outputs=value.outputs, history=value.history, sample_time=step,
        members=tuple(net for net, *_ in trained), means=means, scales=scales,
        out_means=out_means, out_scales=out_scales,
        sigma=np.maximum(np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)), 1e-9), channel=channel,
        model="" if model is None else fingerprint(model), data=data_hash(even, value.inputs, channel), trained=about,
    )  # fmt: skip


def _checked(given: Sequence[Recording], variant: str, model: MotionModel | None) -> tuple[Variant, str]:
    """The variant, and the drive's command that it reads."""
    value = VARIANTS.get(variant)
    if value is None:
        raise BadInput(f"There is no variant {variant!r} of actuator networks.{near_or_all(variant, VARIANTS)}")
    if not given:
        raise BadInput("There is no recording to train on; name at least one.")
    if value.residual and model is None:
        raise BadInput("A residual network adds to a model: give it with model=.")
    if model is not None and not value.residual:
        raise BadInput(f"Networks of variant {variant} add to no model; omit model, or choose the variant 'residual'.")
    channel = "" if DRIVE not in value.inputs else _channel(given, model)
    for recording in given:
        recording.require(
            [channel if name == DRIVE else name for name in value.inputs], f"an actuator network ({variant})"
        )
        recording.must_run()
    return value, channel


def _scales(step_windows: StepWindows, outputs: Sequence[str], residual: bool) -> tuple[Array, Array, Array, Array]:
    """Means and spreads of what is read, and of what is to be said, with which numbers are of order one."""
    if len(step_windows) < 2:
        raise BadInput("Fewer than two windows of the recordings have all readings: there is nothing to learn from.")
    now, after = step_windows.seen[:, 0], step_windows.following - step_windows.own
    scales, out = np.std(now, axis=0), np.std(after, axis=0)
    for name, spread in zip(outputs, np.std(step_windows.following, axis=0), strict=True):
        if not spread > 0:
            raise BadInput(f"{name} is constant: the vehicle's response cannot be learned from it.")
    # a command that is never given tells nothing: it is read as zero
    scales, out = np.where(scales > 0, scales, 1.0), np.where(out > 0, out, 1.0)
    return np.mean(now, axis=0), scales, np.zeros(len(out)) if residual else np.mean(after, axis=0), out


def _descended(loss: SquaredError, held: SquaredError, start: Array, steps: int, seed: int, say: Say) -> Descent:
    def outside(q: Array) -> float:
        return float(np.sqrt(np.mean(held.errors(q) ** 2)))

    def told(step: int, value: float, error: float) -> None:
        if step % _SAID == 0:
            say(f"actuator network, seed {seed}: step {step}, error {np.sqrt(2 * value):.4f}, held out {error:.4f}")

    free = np.tile([-np.inf, np.inf], (len(start), 1))
    return descend(loss, outside, start, free, warm_up=ADAM, steps=steps, patience=PATIENCE, say=told)


def _channel(given: Sequence[Recording], model: MotionModel | None) -> str:
    """The drive's command that all recordings hold."""
    known = DRIVE_SIGNALS if model is None else (*model.aliases.get(DRIVE, ()), DRIVE)
    shared = [name for name in known if all(name in recording for recording in given)]
    if not shared:
        raise BadInput(
            f"{given[0].name} holds no drive command that all recordings share: one of {', '.join(known)} is needed. "
            "Map its column in the column map (‹columns›)."
        )
    return shared[0]


def _foretold(model: MotionModel | None, recording: Recording, outputs: Sequence[str]) -> Array:
    """(n, outputs) what the model says of the row after each; zeros without one."""
    if model is None:
        return np.zeros((len(recording), len(outputs)))
    value = OpenLoop(model, recording).foretold[:, [PLANE.index(name) for name in outputs]]
    result = np.full_like(value, np.nan)
    result[:-1] = value[1:]
    return result
