"""Which parameters of a map with memory may move when it is adapted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...base.errors import BadInput, near
from ...base.shorthands import Array
from ...datasets.recording import Recording
from ...engine.least_squares import NormalEquations
from ...engine.shooting import Nodes, Problem
from ...engine.trace import Trace
from ...models.effects import EFFECTS
from ...models.memory_model import MemoryModel
from ...models.parameter import Parameter, Prior

FEW = {"steering_ratio": ("yaw_rate", 0.1), "steering_offset": ("yaw_rate", 0.02), "motor_gain": ("a_x", 0.2)}
"""Effects that stand for what changes on a car between two days: the output that tells each, and its prior's standard
deviation about no change, in the effect's unit."""
RESPONSES = ("F", "F_y", "F_v", "F_t", "F_b")
"""Impulse responses of the networks."""
PAPER = (*RESPONSES[:1], "G_1t", "b_1t", "G_2t", "G_1b", "b_1b", "G_2b", "m")
"""What Mungiello et al. say they tuned: the impulse responses of the lateral network, the actuation network and the
mass of the longitudinal one."""
SUBSETS = ("F", "few", "paper", "physical", "all")
"""Words for sets of parameters, besides names."""
COMPARED = ("few", "F", "all")
"""Sets that are compared unless one is asked for, the fewest parameters first."""
ADAPTING = "adaptation"
"""Name of the strength of all priors of an adaptation."""
PHYSICAL_SD = 0.1
"""Standard deviation of an adapted number that had no prior, as a share of its size."""


def part_with_few(part: MemoryModel) -> MemoryModel:
    """A part with the effects of `FEW` that it is told by, at no change; what it has already stays its own."""
    for name, (output, sd) in FEW.items():
        effect = EFFECTS[name]
        if output in part.outputs and name not in part and effect.concerns(part):
            part = part + effect
            held = part[name]
            part = part.with_parameters(
                replace(held, value=float(held.null or 0.0), prior=Prior(sd, mean=float(held.null or 0.0)))
            )
    return part


def about_itself(part: MemoryModel) -> MemoryModel:
    """The same model with all its priors about its own values: how far they moved is what is weighed.

    Shapes of priors stay: impulse responses change smoothly, and most where they are youngest. Parameters of runs are
    fixed for all runs alike, and no run is mirrored: a car may have come to pull to one side.
    """
    return replace(
        part.with_parameters(*(_about_itself(parameter, part) for parameter in part.parameters)), symmetric=False
    )


def _about_itself(parameter: Parameter, part: MemoryModel) -> Parameter:
    if parameter.scope == "run" or (parameter.name in part.effects and parameter.name not in FEW):
        return replace(parameter, scope="model", fixed=True)
    parameter = replace(parameter, fixed=False)  # the closed loop of a coupled model holds some
    if parameter.prior is None:
        return replace(
            parameter, prior=Prior(PHYSICAL_SD * abs(parameter.array) + 1e-6, mean=parameter.array, strength=ADAPTING)
        )
    return replace(parameter, prior=replace(parameter.prior, mean=parameter.array, strength=ADAPTING))


def members(subset: str, part: MemoryModel) -> tuple[str, ...]:
    """Names of the parameters of a part that a set holds; of none, where the part has none of them."""
    free = [parameter for parameter in part.parameters if not parameter.fixed]
    words = {
        "F": [item.name for item in free if item.name in RESPONSES],
        "few": [item.name for item in free if item.name in FEW],
        "paper": [item.name for item in free if item.name in PAPER],
        "physical": [item.name for item in free if item.shape == () and item.name not in FEW],
        "all": [item.name for item in free if item.name not in FEW],
    }
    result: list[str] = []
    for word in subset.split(","):
        word = word.strip()
        result += words.get(word, [one.name for one in free if one.name == word or one.name.startswith(f"{word}_")])
    return tuple(dict.fromkeys(result))


def must_name_something(subset: str, parts: Sequence[MemoryModel]) -> None:
    """Raise `BadInput` for a word that is no set and no parameter of any part."""
    for word in subset.split(","):
        if not any(members(word, part) for part in parts):
            known = [
                "auto",
                *SUBSETS,
                *(parameter.name for part in parts for parameter in part.parameters if not parameter.fixed),
            ]
            raise BadInput(
                f"‹free›: {word.strip()!r} is no set of parameters and no parameter of this fit; there are auto, "
                f"{', '.join(SUBSETS)} and names of parameters.{near(word.strip(), known)}"
            )


def learnt(
    part: MemoryModel, noise: Mapping[str, float], sd: Mapping[str, Array], trained: Sequence[Recording] | None
) -> Array:
    """Precision of a part's parameters by its training data alone, (parameters, parameters), about its own values.

    The curvature of the training data's sum of squares. Without the data, what the fit's standard deviations say of
    each weight by itself. Of the few effects that stand for a change of
    the car, the old data say nothing.
    """
    few = np.concatenate([np.full(parameter.size, parameter.name in FEW) for parameter in part.parameters])
    if trained is None:
        spread = np.concatenate(
            [np.broadcast_to(sd.get(parameter.name, np.inf), parameter.shape).ravel() for parameter in part.parameters]
        ).astype(float)
        known = np.isfinite(spread) & (spread > 0) & ~few
        return np.diag(np.where(known, 1.0 / np.where(known, spread, 1.0) ** 2, 0.0))
    problem = Problem(Trace(part), trained, noise=np.array([noise[name] for name in part.outputs]))
    J = np.concatenate([item for _, item in problem.residuals(problem.start, [])]).reshape(-1, len(few))
    J[:, few] = 0.0
    return np.asarray(J.T @ J)


class Held(Problem):
    """A problem that is held to a point by what was learnt before, as a quadratic.

    Parameters
    ----------
    part, recording, noise : as of `Problem`.
    precision : (parameters, parameters) about the part's own values.
    """

    def __init__(self, part: MemoryModel, recording: Recording, noise: Array, precision: Array) -> None:
        super().__init__(Trace(part), [recording], noise=noise)
        self._precision, self._about = precision, part.values

    def objective(self, x: Array, nodes: Nodes) -> float:
        """Half the sum of squares, and what moving away from the point costs."""
        away = x - self._about
        return super().objective(x, nodes) + 0.5 * float(away @ self._precision @ away)

    def normal_equations(self, x: Array, nodes: Nodes) -> NormalEquations:
        """Those of the problem with the quadratic."""
        value = super().normal_equations(x, nodes)
        free = self.free.astype(float)
        precision = self._precision * np.outer(free, free)
        return NormalEquations(value.H + precision, value.g + precision @ (x - self._about))
