"""Models of motion in which an actuator network acts: the next yaw rate is its own, and the rest follows from that.

Over a step of the network the model of motion is driven freely first; that says where yaw rate (and v_y, of networks
that say it) would be. Then it is driven again, with a yaw acceleration that leads, evenly over the step, to

    (1 - w) model + w network

and v_y, v_x, actuators and the place on the path follow from that motion. w is 1, or 1 / (1 + (spread / sigma)^2) with
the spread of several networks and their error on what was held out: where they were not trained they part, and the
model of motion is left as it is. A network that says what the model says changes nothing, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

import casadi as cs
import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.json_data import checksum, plain
from greybox_id.base.shorthands import Array
from greybox_id.engine.kernel import Kernel
from greybox_id.export.equations import Equations
from greybox_id.models.model import Model, Symbol, must_be
from greybox_id.models.motion_model import MotionModel, Quantities
from greybox_id.models.parameter import Parameter

from ..racing.stage import BEND, Period, SteppedModel, moved_along
from .net import DRIVE, ActuatorNet

LEARNED = "learned_yaw"
"""What the effect is called among those of a model."""
PUSH = Parameter("learned_yaw_acceleration", "rad/s^2", 0.0, fixed=True, about="that produces the network's yaw rate")

Weight = float | Literal["spread"]


@dataclass(frozen=True, kw_only=True, repr=False)
class InjectedModel(SteppedModel):
    """A model of motion in which an actuator network acts, made by `injected`.

    It steps from sample to sample of the network: it is driven in `racing.world.World` and along recordings by
    `learned.open_loop`. What needs equations in continuous time (fits, exports, the compiled simulator) refuses it.

    Attributes
    ----------
    net : the network.
    weight : see `injected`.
    equations : those of motion, without the network.
    """

    net: ActuatorNet
    weight: Weight = 1.0
    equations: Callable[..., Mapping[str, Symbol]] = field(compare=False)

    @property
    def physics(self) -> MotionModel:
        """The model without the network, with all its other effects."""
        value: dict[str, Any] = {one.name: getattr(self, one.name) for one in fields(MotionModel)}
        effects = tuple(name for name in self.effects if name != LEARNED)
        return MotionModel(**{**value, "dynamics": self.equations, "effects": effects})

    def stage(self, period: float, moving: Collection[str] = ()) -> Period:
        """Its stage; see `LearnedPeriod`."""
        return LearnedPeriod(self, period, moving)


def injected(model: Model, net: ActuatorNet, weight: Weight | None = None) -> InjectedModel:
    """The model in which the network acts.

    Parameters
    ----------
    model : of motion, at its values; with states v_x, v_y and yaw rate, steered and driven (`single_track`).
    net : see `train_actuator_net`.
    weight : of what the network says, 0 to 1, or "spread": the less, the further its members are apart. None: 1 of a
        single network, "spread" of several.

    Raises
    ------
    BadInput : the model is none of motion or was injected already, reads another drive command than the network,
        delays commands that the network has learned the delay of, or is another than a residual one was trained beside.

    Examples
    --------
    >>> import greybox_id as gb
    >>> from greybox_lab.driving.learned.injection import injected
    >>> from greybox_lab.driving.learned.training import train_actuator_net
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> net = train_actuator_net(lap, steps=3)
    >>> model = injected(gb.models.single_track(vehicle="roboracer"), net)
    >>> model.effects, model.physics.effects
    (('learned_yaw',), ())
    """
    no = f"{model.name} has no equations of motion, so a network cannot act in them. Name single_track."
    model = must_be(MotionModel, model, no)
    if isinstance(model, InjectedModel):
        raise BadInput(f"{model.name} has a network already; inject into its equations of motion (.physics).")
    result: Weight = ("spread" if len(net.members) > 1 else 1.0) if weight is None else weight
    if result != "spread" and (isinstance(result, str) or not 0.0 <= result <= 1.0):
        raise BadInput(f"weight: a number from 0 to 1 or 'spread' is needed, not {result!r}.")
    if result == "spread" and len(net.members) < 2:
        raise BadInput("weight: one network has no spread; train several (‹members›), or give a number from 0 to 1.")
    period = Period(model, net.sample_time)  # says what is wrong with a model that moves along no path
    known = (period.drive, *model.aliases.get(period.drive, ()))
    if net.channel and net.channel not in known:
        raise BadInput(f"The network reads {net.channel}, but {model.name} is driven by {', '.join(known)}.")
    if net.residual:
        if net.model != fingerprint(model):
            raise BadInput(
                f"The network corrects the model that it was trained with; {model.name} is another model or has "
                "other parameter values. Train it again with model=."
            )
    else:
        late = {name: seconds for name, seconds in period.equations.shifts().items() if name.startswith("delay")}
        if late:
            entry = ", ".join(f"{name} {1e3 * seconds:.3g} ms" for name, seconds in late.items())
            raise BadInput(
                f"{model.name} delays commands ({entry}), and the network has learned their delay from recordings: it "
                "would act twice. Inject into the model without it, or train variant='residual' with model=."
            )
    parts: dict[str, Any] = {one.name: getattr(model, one.name) for one in fields(MotionModel)}
    parts |= {"effects": (*model.effects, LEARNED), "dynamics": _refusing(model.name, net.sample_time)}
    return InjectedModel(**parts, net=net, weight=result, equations=model.dynamics)


def fingerprint(model: MotionModel) -> str:
    """Says which model this is, with its values."""
    values = {parameter.name: parameter.array for parameter in model.parameters}
    return checksum(plain({"name": model.name, "effects": model.effects, "values": values}))


def _refusing(name: str, sample_time: float) -> Callable[..., Mapping[str, Symbol]]:
    def dynamics(*_: object) -> Mapping[str, Symbol]:
        raise BadInput(
            f"{name} has an actuator network with steps of {sample_time:g} s, and no equations in continuous time. "
            "Drive it (racing.worlds.world) or simulate it along a recording (learned.open_loop); fit and export its "
            ".physics."
        )

    return dynamics


class LearnedPeriod(Period):
    """A period in which an actuator network acts; its states hold the steps that the network has seen.

    Parameters
    ----------
    model : with its network.
    period : s, a whole number of the network's sample times, over which commands are constant.
    moving : as for `Period`.

    Raises
    ------
    BadInput : the period is no whole number of the network's sample times.
    """

    def __init__(self, model: InjectedModel, period: float, moving: Collection[str] = ()) -> None:
        self.net, self._weight = model.net, model.weight
        times = round(period / self.net.sample_time)
        if times < 1 or abs(times * self.net.sample_time - period) > 1e-6 * period:
            raise BadInput(
                f"The network has steps of {self.net.sample_time:g} s, and a period of {period:g} s is not a whole "
                "number of them: train it with that sample_time, or choose another period."
            )
        self._times, self._chosen = times, (*moving, PUSH.name)
        super().__init__(model.physics, self.net.sample_time, moving)
        self.period = period
        reads = ["steer" if name == "steer" else self.drive if name == DRIVE else name for name in self.net.inputs]
        self._of_commands = [(k, self.inputs.index(name)) for k, name in enumerate(reads) if name in self.inputs]
        self._of_states = [(k, self.states.index(name)) for k, name in enumerate(reads) if name in self.states]
        steps = range(1, self.net.history)
        self.states += [f"{name}, {step} steps ago" for step in steps for name in self.net.inputs]
        self.size, self.memory = len(self.states), self.net.history - 1

    def advance(self, z: Array, acting: Array, bend: Array, p: Array) -> Array:
        """z a period later, of every lane; see `Period.advance`."""
        for _ in range(self._times):
            z = self._stepped(z, acting, bend, p)
        return z

    def begun(self, v_x: float, p: Array) -> tuple[Array, Array, float]:
        """A vehicle that has driven straight ahead for long, and a network that has seen it; see `Period.begun`."""
        x, delays, grip = super().begun(v_x, p)
        row = self._row(x[None], np.zeros((1, len(self.inputs))))[0]
        return np.concatenate([x, np.tile(row, self.net.history - 1)]), delays, grip

    def _stepped(self, z: Array, acting: Array, bend: Array, p: Array) -> Array:
        n, lanes = self.motion, len(z)
        now, numbers = np.concatenate([z[:, :n], z[:, -3:]], axis=1), np.concatenate([acting, bend], axis=1)
        free = self._driven_on(now, numbers, np.zeros((lanes, len(self._said))), p)
        seen = np.concatenate([self._row(z, acting), z[:, n:-3]], axis=1).reshape(lanes, self.net.history, -1)
        value = free[:, self._said]
        stated = self.net.following(seen, value)
        push = self._share(stated) * (np.mean(stated, axis=0) - value)
        after = self._driven_on(now, numbers, push, p)
        return np.concatenate([after[:, :n], seen[:, :-1].reshape(lanes, -1), after[:, n:]], axis=1)

    def _driven_on(self, z: Array, numbers: Array, push: Array, p: Array) -> Array:
        known = np.concatenate([numbers, push], axis=1)[:, None, :]
        return self._kernel.simulate(z, known, p, [False])[0][:, 1]

    def _row(self, z: Array, acting: Array) -> Array:
        """(L, inputs) what the network sees now."""
        row = np.empty((len(z), len(self.net.inputs)))
        for k, column in self._of_commands:
            row[:, k] = acting[:, column]
        for k, column in self._of_states:
            row[:, k] = z[:, column]
        return row

    def _share(self, stated: Array) -> float | Array:
        """w."""
        if self._weight != "spread":
            return self._weight
        return np.asarray(1.0 / (1.0 + (np.std(stated, axis=0, ddof=1) / self.net.sigma) ** 2))

    def _made(self) -> Kernel:
        """(z, commands, path and push, p) -> z a step later, where what the network says is led to model + push."""
        self._said = [self.states.index(name) for name in self.net.outputs]
        n, inputs, dt, p = self.motion, len(self.inputs), self.period / self.steps, self.equations.p
        z, s = cs.SX.sym("z", n + 3), cs.SX.sym("s", inputs + len(BEND) + len(self._said))
        acting, bend, push = s[:inputs], s[inputs : inputs + len(BEND)], s[inputs + len(BEND) :]
        forced = Equations(_pushed(self.equations.model), self._chosen)
        turned = cs.vertcat(p, push[self.net.outputs.index("yaw_rate")] / self.period)
        free = x = z[:n]
        path = z[n:]
        for k in range(1, self.steps + 1):
            free = self.equations.step(free, acting, p, dt)
            after = forced.step(x, acting, turned, dt)
            for which, column in enumerate(self._said):
                after[column] = free[column] + k / self.steps * push[which]
            path = moved_along(path, [x[j] for j in self._plane], [after[j] for j in self._plane], bend, dt)
            x = after
        return Kernel(cs.Function("learned", [z, s, p], [cs.vertcat(x, path)]), cs.Function("read", [z, s, p], [z[0]]))


def _pushed(model: MotionModel) -> MotionModel:
    """The model with a yaw acceleration on top, the last of its parameters."""
    value = model.with_parameters(PUSH)

    def rates(q: Quantities) -> Mapping[str, Symbol]:
        return {"yaw_rate": q.rates.yaw_rate + q.p.learned_yaw_acceleration}

    return replace(value, extra_rates=(*value.extra_rates, rates))
