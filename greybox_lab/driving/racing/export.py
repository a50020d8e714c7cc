"""A policy written down for a controller elsewhere: C99, or an ONNX graph in single precision."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from greybox_id.base.errors import BadInput, must_be_one_of
from greybox_id.base.shorthands import Array
from greybox_id.base.version import __version__
from greybox_id.export.c.functions import INLINE
from greybox_id.export.c.mathematics import definitions
from greybox_id.export.c.naming import c_comment, numbers, vector
from greybox_id.export.c.self_test import table
from greybox_id.export.equations import Named
from greybox_id.export.subject import named_in_c
from greybox_id.export.target_c import cmake, commands
from greybox_id.export.template import filled
from greybox_id.export.verb import ForeignResult, write_folder

from .policy import POLICY, Layer, Policy, load_policy
from .world import LARGEST, SEEN

if TYPE_CHECKING:
    from .learner import Learned

TARGETS = {
    "c": "C99 of the policy, with a self-test and a CMake target",
    "onnx": "an ONNX graph of the policy in single precision",
}
OPSET, IR_VERSION = 17, 8
"""Of ONNX: what runtimes from 2022 on read."""
POINTS, TOLERANCE = 100, 1e-6
"""Observations of the self-test, and how far actions may be from Python's: rounding in single precision."""
DONE = {"steering": "of the largest angle", "drive": "drive or target speed, as the rules of the policy's training say"}
"""Actions, and what they are."""
UNITS: Mapping[str, tuple[str, int, str]] = {
    "v_x": ("speed", -1, "m/s"), "v_y": ("speed", -1, "m/s"), "yaw_rate": ("yaw_rate", -1, "rad/s"),
    "e_y": ("half_width", -1, "m"), "curvature": ("half_width", 1, "1/m"), "speed": ("speed", -1, "m/s"),
}  # fmt: skip
"""How names of an observation begin -> which of a world's units they are over (-1) or times (1), and their SI unit."""
HEADING, ASIDE = "e_psi", SEEN.index("sin_e_psi")
"""What stands in the place of the sine of the heading error, rad, where a policy is given SI units."""


@dataclass(frozen=True)
class PolicySubject:
    """A policy to export.

    Attributes
    ----------
    policy : what is written.
    name : what files and functions are called after.
    source : its file's name, for people.
    command : what reproduces the export.

    Raises
    ------
    BadInput : the name can name no functions in C.
    """

    policy: Policy
    name: str
    source: str = ""
    command: str = ""

    def __post_init__(self) -> None:
        named_in_c(self.name)

    @property
    def units(self) -> Mapping[str, float]:
        """What the world's units are in SI; empty where the policy does not say, and takes observations as they are."""
        held = self.policy.about.get("units", {})
        known = {one for one, _, _ in UNITS.values()} <= set(held) and self.policy.size == len(SEEN)
        return held if known else {}

    @property
    def seen(self) -> tuple[str, ...]:
        """Names of the numbers that go in."""
        if self.policy.size != len(SEEN):
            return tuple(f"seen_{k}" for k in range(self.policy.size))
        return tuple(HEADING if self.units and k == ASIDE else name for k, name in enumerate(SEEN))

    @property
    def scales(self) -> Layer:
        """(size,) what they are multiplied by; of the heading error the sine is taken."""
        result = np.ones(self.policy.size, dtype=np.float32)
        for k, name in enumerate(self.seen if self.units else ()):
            if (unit := _unit(name)) is not None:
                result[k] = self.units[unit[0]] ** unit[1]
        return result

    def observation(self, given: Layer) -> Layer:
        """(L, size) what a driver sees, of numbers (L, size) as they go in."""
        result = (given.astype(np.float32) * self.scales).astype(np.float32)
        if self.units:
            result[:, ASIDE] = np.sin(result[:, ASIDE])
        return np.clip(result, np.float32(-LARGEST), np.float32(LARGEST))

    @property
    def title(self) -> str:
        """What it is, in a sentence."""
        return f"{self.name}: a policy, {self.source or 'from Python'}, greybox-id {__version__}."

    def described(self) -> dict[str, Any]:
        """For a manifest."""
        return {
            "name": self.name,
            "greybox_id": __version__,
            "source": self.source,
            "command": self.command,
            "model": {"name": "policy", "inputs": list(self.seen), "outputs": list(DONE)},
            "learned": dict(self.policy.about),
        }


def export_policy(subject: PolicySubject, target: str, folder: str | Path) -> list[Path]:
    """Write a policy for a target into a folder, with a manifest.

    Parameters
    ----------
    subject : the policy and its name.
    target : "c" or "onnx".
    folder : where to; an earlier export there is replaced, whole.

    Returns
    -------
    The files written.

    Raises
    ------
    BadInput : policies are not written for the target, the package onnx is missing, or the folder holds other files.
    """
    must_be_one_of(TARGETS, target, "A policy is not written for")
    files = {"c": _c, "onnx": _onnx}[target](subject)
    return write_folder(Path(folder), files, {"target": target} | subject.described())


def _onnx(subject: PolicySubject) -> Mapping[str, bytes]:
    try:
        import onnx
        from onnx import TensorProto, helper, numpy_helper
    except ImportError as error:
        raise BadInput("The target onnx needs the package onnx; pip install 'greybox-id[onnx]'.") from error
    policy, nodes = subject.policy, []
    held = {"low": np.array(-1.0, dtype=np.float32), "high": np.array(1.0, dtype=np.float32)}
    held |= {"least": np.array(-LARGEST, dtype=np.float32), "most": np.array(LARGEST, dtype=np.float32)}
    scaled = "seen"
    if subject.units:
        sine = np.zeros(policy.size, dtype=np.float32)
        sine[ASIDE] = 1.0
        held |= {"scales": subject.scales, "sine": sine, "itself": 1.0 - sine}
        nodes += [
            helper.make_node("Mul", ["seen", "scales"], ["scaled"]),
            helper.make_node("Sin", ["scaled"], ["sines"]),
            helper.make_node("Mul", ["sines", "sine"], ["turned"]),
            helper.make_node("Mul", ["scaled", "itself"], ["straight"]),
            helper.make_node("Add", ["turned", "straight"], ["observed"]),
        ]
        scaled = "observed"
    nodes.append(helper.make_node("Clip", [scaled, "least", "most"], ["observation"]))
    now = "observation"
    for k, (W, b) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        held |= {f"weights_{k}": W, f"biases_{k}": b}
        nodes.append(helper.make_node("Gemm", [now, f"weights_{k}", f"biases_{k}"], [f"sum_{k}"]))
        now = f"sum_{k}"
        if k + 1 < len(policy.weights):
            nodes.append(helper.make_node("Tanh", [now], [f"layer_{k}"]))
            now = f"layer_{k}"
    nodes.append(helper.make_node("Clip", [now, "low", "high"], ["action"]))
    inputs, outputs = (
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", size])]
        for name, size in (("seen", policy.size), ("action", len(DONE)))
    )
    graph = helper.make_graph(
        nodes, subject.name, inputs, outputs, [numpy_helper.from_array(item, name) for name, item in held.items()]
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    about = {"source": subject.source, "seen": json.dumps(subject.seen), "action": json.dumps(list(DONE))}
    helper.set_model_props(made, about | {"units": json.dumps(dict(subject.units))})
    onnx.checker.check_model(made, full_check=True)
    return {f"{subject.name}.onnx": made.SerializeToString()}


def _c(subject: PolicySubject) -> Mapping[str, bytes]:
    name, policy = subject.name, subject.policy
    about: dict[str, object] = {"TITLE": c_comment(subject.title), "SIZE": policy.size, "ACTIONS": len(DONE)}
    seen = vector(name, "SEEN", "observation", [Named(item, *_told(item, subject.units)) for item in subject.seen])
    done = vector(name, "ACTION", "action, -1 to 1", [Named(item, "1", DONE[item]) for item in DONE])
    points = observations(POINTS, policy.size) / subject.scales
    actions = policy.act(subject.observation(points))
    straight = 0.5 * subject.units.get("speed", 1.0)  # at half the top speed
    texts = {
        f"{name}.h": _filled("policy.h", name, SEEN=seen, DONE=done, LARGEST=f"{LARGEST:g}", **about),
        f"{name}.c": _source(subject),
        f"{name}_test.c": _filled(
            "policy_test.c", name, SEEN=table("given_seen", points.astype(float)), POINTS=POINTS,
            EXPECTED=table("expected", actions.astype(float)), TOLERANCE=TOLERANCE, **about,
        ),
        "main.c": _filled("policy_main.c", name, SPEED=f"{straight:.9g}", **about),
        "CMakeLists.txt": cmake(name),
        "README.md": _filled("policy_readme.md", name, TITLE=subject.title, COMMANDS=commands(name)),
    }  # fmt: skip
    return {name: text.encode() for name, text in texts.items()}


def _filled(template: str, name: str, **words: object) -> str:
    return filled(template, name, __package__, **words)


def _unit(name: str) -> tuple[str, int, str] | None:
    """Which of a world's units a number is in, how, and its SI unit; None where it has none."""
    return next((item for begins, item in UNITS.items() if name.startswith(begins)), None)


def _told(name: str, units: Mapping[str, float]) -> tuple[str, str]:
    """Unit of a number that goes in, and what becomes of it, for people."""
    unit = _unit(name)
    if not units:
        return "1", "over that of its training" if unit else "as it is"
    if name == HEADING:
        return "rad", "heading error, to the left"
    return ("1", "as last commanded") if unit is None else (unit[2], "")


def _source(subject: PolicySubject) -> str:
    policy, name = subject.policy, subject.name
    layers = list(zip(policy.weights, policy.biases, strict=True))
    sizes = [policy.size, *(len(b) for b in policy.biases)]
    tables = "\n".join(_tables(k, W, b) for k, (W, b) in enumerate(layers))
    functions = "\n".join(_layer(k, *shape, k + 1 == len(layers)) for k, shape in enumerate(pairwise(sizes)))
    heading = f"    scaled[{ASIDE}] = sin(scaled[{ASIDE}]);\n" if subject.units else ""
    between = "".join(f"    double h{k}[{size}];\n" for k, size in enumerate(sizes[1:-1]))
    places = ["scaled", *(f"h{k}" for k in range(len(layers) - 1)), "action"]
    calls = "".join(f"    layer_{k}({a}, {b});\n" for k, (a, b) in enumerate(pairwise(places)))
    return _filled(
        "policy.c", name, TITLE=c_comment(subject.title), SIZE=policy.size, INLINE=INLINE, TABLES=tables,
        TANH=definitions({"own_tanh"}), SCALES=_singles(subject.scales), FUNCTIONS=functions, BETWEEN=between,
        HEADING=heading, LARGEST=f"{LARGEST:.1f}", CALLS=calls,
    )  # fmt: skip


def _tables(k: int, W: Layer, b: Layer) -> str:
    """Weights, input by input, and biases; as they are in single precision."""
    return (
        f"static const float weights_{k}[{W.shape[0]}][{W.shape[1]}] = {{\n"
        + ",\n".join(f"    {{\n{_singles(row)}\n    }}" for row in W)
        + f"\n}};\nstatic const float biases_{k}[{len(b)}] = {{\n{_singles(b)}\n}};\n"
    )


def _singles(row: Layer) -> str:
    return numbers(float(str(value)) for value in row).replace(",", "f,") + "f"


def _layer(k: int, given: int, results: int, last: bool) -> str:
    bounded = "z[j] < -1.0 ? -1.0 : z[j] > 1.0 ? 1.0 : z[j]" if last else "own_tanh(z[j])"
    return _filled("policy_layer.c", "", LAYER=k, GIVEN=given, RESULTS=results, BOUNDED=bounded)


def observations(count: int, size: int, seed: int = 0) -> Layer:
    """(count, size) numbers as observations have them, some of them as large as they may be."""
    generator = np.random.default_rng(seed)
    spread = generator.choice([0.3, 1.0, 10.0], (count, 1))
    drawn: Array = np.clip(spread * generator.normal(size=(count, size)), -LARGEST, LARGEST)
    return drawn.astype(np.float32)


class PolicyExporter:
    """Policies, for `greybox export` and `gb.export`: the entry point `greybox.exporters`."""

    format, what, targets = POLICY.format, "policy", TARGETS

    @staticmethod
    def load(path: str | Path) -> Policy:
        """The policy of a file."""
        return load_policy(path)

    @staticmethod
    def takes(result: object) -> bool:
        """Whether it is a policy, or what was learned with one."""
        return isinstance(result, Policy) or isinstance(getattr(result, "policy", None), Policy)

    @staticmethod
    def write(result: Policy | Learned, named: ForeignResult, target: str, to: str | Path) -> list[Path]:
        """Write it for a target into a folder; the files."""
        policy = result if isinstance(result, Policy) else result.policy
        return export_policy(PolicySubject(policy, named.name, named.source, named.command), target, to)
