"""Network files as nnodely writes them, with random weights, and what nnodely predicts with them.

    pip install torch==2.13.0 && pip install --no-deps nnodely && pip install pandas matplotlib onnx graphviz reportlab
    python benchmarks/nnodely_files.py --out tests/exchange/nnodely

needs nothing of greybox-id. Each NAME.json is a file of nnodely's own `saveModel`; NAME.windows.json holds random
windows, oldest sample first, and nnodely's predictions from them, in float32 as it is and in double precision. Sizes
differ from the paper's where that keeps files small. `renamed` states the same family in other words: other names, the
speed multiplied outside, local models without centres, windows in seconds.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import nnodely as nn
import numpy as np
import torch

WINDOWS = 12
SCALES = {"v_x": (0.2, 4.0), "steer": (-0.5, 0.5), "a_x": (-6, 6), "a_y": (-7, 7), "motor_current": (-30, 30)}


def curvature(steer, v, steer_0, v_0, a, a_0, k1, k2, k3, k4):
    """Local model of the yaw rate, Eq. 2."""
    return v * (k1 + k2 * (steer - steer_0) + k3 * (v - v_0) + k4 * (a - a_0))


def bend(a, d, offset, by_a, by_d):
    """Local model of the curvature about zero, without a slope over speed."""
    bent = torch.mul(by_d, d)
    return torch.add(offset, bent) - (-by_a * a)


def lateral_force(a_y, a_y_0, q1, q2):
    """Local model of the front axle's lateral force, Eq. 14."""
    return q1 + q2 * (a_y - a_y_0)


def driving(current):
    """Positive currents."""
    return torch.mul(current, torch.gt(current, 0))


def braking(current):
    """The others."""
    return current * ~(current > 0)


def newton(torque, v, F_y, steer, r, m, k_a, c_l, c_r, I_w):
    """Newton's law along the vehicle, Eq. 12, each torque that of one of two wheels."""
    gravity = 9.81
    force = 2 * (torque / r) - k_a * v**2 - c_l * v - F_y * torch.sin(steer)
    return ((1.0 / m) * force - c_r * gravity) / (1.0 + (2.0 / m) * (2 * (I_w / r**2.0)))


def newton_by_axle(I_front, torque, side, steer, v, m, I_rear, drag, damping, rolling, r):
    """The same in other words, with an inertia for each axle."""
    inertial = m + 2 * (I_front + I_rear) / torch.square(r)
    along = torque / r - v * (drag * v + damping) - side * torch.sin(steer)
    return (along - 9.81 * m * rolling) / inertial


def numbers(rng: np.random.Generator, low: float, high: float) -> list[list[float]]:
    return [[float(rng.uniform(low, high))]]


def local(names: list[str], streams: list[Any], centres: list[list[float]], rng: np.random.Generator, prefix: str):
    """The quasi steady state of MS-NN-lat (speed, steering, acceleration)."""
    function = nn.ParamFun(curvature)
    fixed = [
        [nn.Constant(f"{prefix}{name}_{k}", values=c) for k, c in enumerate(own)]
        for name, own in zip(names, centres, strict=True)
    ]

    def at(place):
        def model(v, steer, a):
            k = [
                nn.Parameter(f"{prefix}k{n}_{'_'.join(map(str, place))}", values=numbers(rng, -s, s))
                for n, s in zip((1, 2, 3, 4), (1.0, 3.0, 0.3, 0.1), strict=True)
            ]
            l, j, i = place
            return function(steer, v, fixed[1][j], fixed[0][l], a, fixed[2][i], *k)

        return model

    fuzzy = tuple(nn.Fuzzify(centers=own)(stream) for own, stream in zip(centres, streams, strict=True))
    return nn.LocalModel(input_function=at, pass_indexes=True)(tuple(streams), fuzzy)


def lat(v, steer, a, window: int, sizes: tuple[int, int, int], rng: np.random.Generator, prefix: str = ""):
    streams = [v.sw(window), steer.sw(window), a.sw(window)]
    ranges = ((-0.3, 3.9), (-0.37, 0.52), (-5.1, 6.1))
    centres = [np.linspace(*ends, n).tolist() for ends, n in zip(ranges, sizes, strict=True)]
    steady = local([v.name, steer.name, a.name], streams, centres, rng, prefix)
    over = tuple(nn.Fuzzify(centers=centres[k])(streams[k]) for k in (0, 2))
    return nn.LocalModel(output_function=lambda: nn.Fir())(steady, over)


def long(v, current, steer, a_y, window: int, sizes: tuple[int, int, int], rng: np.random.Generator, by_axle: bool):
    eta, n_v, n_y = sizes
    torques = [
        nn.Linear()(nn.Tanh(nn.Fir(output_dimension=eta, b=True, dropout=0.05)(nn.ParamFun(part)(current.sw(window)))))
        for part in (driving, braking)
    ]
    centres = np.linspace(-3.7, 6.6, n_y).tolist()
    fixed = [nn.Constant(f"a_y_{k}", values=c) for k, c in enumerate(centres)]
    function = nn.ParamFun(lateral_force)

    def at(place):
        q = [nn.Parameter(f"q{n}_{place[0]}", values=numbers(rng, -s, s)) for n, s in ((1, 9.0), (2, 2.0))]
        return lambda stream: function(stream, fixed[place[0]], *q)

    steady = nn.LocalModel(input_function=at, pass_indexes=True)(
        a_y.sw(window), nn.Fuzzify(centers=centres)(a_y.sw(window))
    )
    over = nn.Fuzzify(centers=np.linspace(-0.3, 3.6, n_v).tolist())(v.sw(window))
    F_y = nn.LocalModel(output_function=lambda: nn.Fir())(steady, over)
    ranges = {"r": (0.05, 0.06), "m": (3, 4), "k_a": (0, 0.1), "c_l": (0, 1), "c_r": (0.01, 0.05), "I_w": (4e-5, 6e-5)}
    own = {name: nn.Parameter(name, values=numbers(rng, *ends)) for name, ends in ranges.items()}
    if not by_axle:
        head = nn.ParamFun(newton, parameters_and_constants=list(own.values()))
        return head(torques[0] + torques[1], v.last(), F_y, steer.last())
    other = nn.Parameter("I_w2", values=numbers(rng, 1e-5, 9e-5))
    rest = [own[name] for name in ("m", "I_w", "k_a", "c_l", "c_r", "r")]
    head = nn.ParamFun(newton_by_axle)
    return head(other, torques[0] + torques[1], F_y, steer.last(), v.last(), *rest)


def renamed(rng: np.random.Generator):
    """MS-NN-lat in other words."""
    speed, wheel, push = nn.Input("omega_rear"), nn.Input("handwheel"), nn.Input("imu_long")
    seconds = 0.25
    streams = [wheel.tw(seconds), speed.tw(seconds), push.tw(seconds)]
    centres = [[-0.3, 0.1, 0.4], [0.5, 3.0], [0.0]]
    function = nn.ParamFun(bend)

    def at(place):
        name = "abc"[place[0]] + "xy"[place[1]]
        k = [nn.Parameter(f"{n}{name}", values=numbers(rng, -1, 1)) for n in ("offset", "slope", "gain")]
        return lambda d, _, a: function(a, d, *k)

    fuzzy = tuple(nn.Fuzzify(centers=own)(stream) for own, stream in zip(centres, streams, strict=True))
    steady = nn.LocalModel(input_function=at, pass_indexes=True)(tuple(streams), fuzzy)
    over = (fuzzy[1], fuzzy[2])
    out = nn.LocalModel(output_function=lambda: nn.Fir())(streams[1] * steady, over)
    return (speed, wheel, push), out


def without_acceleration(v: Any, steer: Any, rng: np.random.Generator) -> Any:
    """The paper's second ablation: MS-NN-lat that knows nothing of the acceleration."""
    streams = (v.sw(4), steer.sw(4))
    over = tuple(
        nn.Fuzzify(centers=centres)(own) for own, centres in zip(streams, ([0.3, 2.9], [-0.3, 0.3]), strict=True)
    )

    def at(place):
        k = [nn.Parameter(f"k{n}_{place[0]}_{place[1]}", values=numbers(rng, -1, 1)[0]) for n in (1, 2, 3)]
        return lambda speed, angle: speed * (angle * k[0] + k[1]) - k[2] * speed * speed

    steady = nn.LocalModel(input_function=at, pass_indexes=True)(streams, over)
    return nn.LocalModel(output_function=lambda: nn.Fir())(steady, over[0])


def made(name: str, rng: np.random.Generator) -> tuple[nn.nnodely, dict[str, str]]:
    """The network of that name, and which of its inputs holds which signal."""
    vx, steer, ax = nn.Input("vx"), nn.Input("steer"), nn.Input("ax")
    net = nn.nnodely(visualizer=None, seed=1)
    if name in ("lat", "lat_small"):
        window, sizes = (20, (2, 5, 2)) if name == "lat" else (4, (3, 2, 1))
        rate = nn.Input("yaw_rate")
        out = nn.Output("yaw_rate_", lat(vx, steer, ax, window, sizes, rng))
        net.addModel("lateral", [out])
        net.addMinimize("error", rate.next(), out, loss_function="rmse")
        return net, {"vx": "v_x", "steer": "steer", "ax": "a_x"}
    if name == "lat_without_a_x":
        net.addModel("lateral", [nn.Output("rate", without_acceleration(vx, steer, rng))])
        return net, {"vx": "v_x", "steer": "steer"}
    if name == "renamed":
        (speed, wheel, push), stream = renamed(rng)
        net.addModel("turning", [nn.Output("turn", stream)])
        return net, {speed.name: "v_x", wheel.name: "steer", push.name: "a_x"}
    vel, crt, delta, accy = nn.Input("vel"), nn.Input("crt"), nn.Input("delta"), nn.Input("accy")
    if name in ("long", "long_by_axle"):
        sizes = (15, (6, 2, 4)) if name == "long" else (5, (3, 2, 1))
        out = nn.Output("acceleration", long(vel, crt, delta, accy, *sizes, rng, by_axle=name != "long"))
        acc = nn.Input("acc")
        net.addModel("acc", [out])
        net.addMinimize("error", acc.next(), out, loss_function="rmse")
        return net, {"vel": "v_x", "crt": "motor_current", "delta": "steer", "accy": "a_y"}
    acc = nn.Input("acc")
    along = long(vel, crt, delta, accy, 4, (2, 2, 2), rng, by_axle=False)
    turning = lat(vel, delta, acc, 6, (2, 2, 1), rng, "lat_")
    outs = [nn.Output("acceleration", along), nn.Output("rate", turning), nn.Output("across", turning * vel.last())]
    net.addModel("combined", outs)
    if name == "full_closed":
        net.addClosedLoop(along, acc)
        net.addClosedLoop(outs[2], accy)
    return net, {"vel": "v_x", "crt": "motor_current", "delta": "steer", "accy": "a_y", "acc": "a_x"}


NAMES = ("lat_without_a_x", "lat", "lat_small", "renamed", "long", "long_by_axle", "full", "full_closed")


def write(name: str, folder: Path) -> None:
    nn.clearNames()
    rng = np.random.default_rng(sum(map(ord, name)))
    net, roles = made(name, rng)
    net.neuralizeModel(0.05)
    for key, parameter in net._model.all_parameters.items():
        if key.startswith("P"):
            parameter.data = torch.tensor(rng.normal(0, 0.3, parameter.shape), dtype=parameter.dtype)
    net._model.eval()  # a network that was never trained would drop neurons out at random as it predicts
    net._model_def.updateParameters(net._model)
    with tempfile.TemporaryDirectory() as workspace:
        saver = nn.nnodely(visualizer=None, workspace=workspace)
        saver._model_def = net._model_def
        saver.saveModel(name, workspace)
        (folder / f"{name}.json").write_text((Path(workspace) / f"{name}.json").read_text())
    inputs = net.json["Inputs"]
    longest = max(own["ns"][0] for own in inputs.values())
    windows = {
        key: np.round(rng.uniform(*SCALES[role], (WINDOWS, longest)), 4).astype(np.float32).astype(float)
        for key, role in roles.items()
    }
    body = {
        "roles": roles,
        "windows": {key: np.round(values, 4).tolist() for key, values in windows.items()},
        "predictions": predictions(net, windows),
    }
    with in_double(folder, name) as loaded:
        body["double"] = predictions(loaded, {key: np.round(values, 4) for key, values in windows.items()})
        if name == "full_closed":
            body["loop"] = closed_loop(loaded, rng)
    (folder / f"{name}.windows.json").write_text(json.dumps(body) + "\n")


def predictions(net: nn.nnodely, windows: dict[str, np.ndarray]) -> dict[str, list[float]]:
    inputs, found = net.json["Inputs"], {}
    for k in range(WINDOWS):
        given = {key: values[k, -inputs[key]["ns"][0] :].tolist() for key, values in windows.items()}
        for key, values in net(inputs=given, prediction_samples=-1).items():
            found.setdefault(key, []).append(float(np.ravel(values)[0]))
    return found


@contextmanager
def in_double(folder: Path, name: str) -> Iterator[nn.nnodely]:
    """The file, loaded by nnodely, with its arithmetic in double precision."""
    modules = [own for key, own in sys.modules.items() if key.startswith("nnodely") and hasattr(own, "TORCH_DTYPE")]
    for own in modules:
        own.TORCH_DTYPE = torch.float64
    torch.set_default_dtype(torch.float64)
    nn.clearNames()
    net = nn.nnodely(visualizer=None, workspace=str(folder))
    net.loadModel(name, str(folder))
    net.neuralizeModel()
    net._model.eval()
    yield net
    torch.set_default_dtype(torch.float32)
    for own in modules:
        own.TORCH_DTYPE = torch.float32


def closed_loop(net: nn.nnodely, rng: np.random.Generator) -> dict[str, dict[str, list[float]]]:
    """A run of MS-NN-full on its own predictions, at constant speed, from a window of readings on."""
    inputs = net.json["Inputs"]
    window = max(own["ns"][0] for own in inputs.values())
    rows, speed = window + WINDOWS - 1, 2.0
    read = {"delta": rng.uniform(-0.4, 0.4, rows), "crt": rng.uniform(-20, 20, rows), "vel": np.full(rows, speed)}
    rate = np.round(rng.uniform(-1, 1, window), 4)
    read |= {"acc": rng.uniform(-3, 3, window), "accy": rate * speed}
    read = {key: np.round(values, 4) for key, values in read.items()}
    given = {key: values[window - inputs[key]["ns"][0] :].tolist() for key, values in read.items()}
    found = net(inputs=given, prediction_samples=WINDOWS - 1)
    told = {key: np.ravel(values).tolist() for key, values in found.items()}
    return {
        "read": {key: values.tolist() for key, values in read.items()} | {"rate": rate.tolist()},
        "predictions": told,
    }


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--out", required=True, type=Path)
    folder = arguments.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    for name in NAMES:
        write(name, folder)


if __name__ == "__main__":
    main()
