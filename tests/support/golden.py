"""Numbers of fits, gaps, tracks and exports on fixed recordings, as `golden.json` beside it holds them.

`PYTHONPATH=tests/support python -m golden` compares, `python -m golden --write` writes. A change that is meant is
written together with its reason in the message of the commit; all others leave every number equal to 1e-9.
"""

import json
import math
import re
import sys
import tempfile
from hashlib import sha256
from pathlib import Path

import greybox_id as gb

GOLDEN = Path(__file__).with_name("golden.json")
EQUAL = 1e-9


def lap():
    return gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 800)


def _fit(name, **more):
    own = lap()
    found = gb.fit(name, own, vehicle="roboracer", **more)
    score = found.score(gb.read(gb.datasets.shipped("racer_valid"), columns="roboracer").rows(0, 400))
    return {
        "params": found.params.to_dict(),
        "stderr": found.stderr.to_dict(),
        "conf_int": found.conf_int().to_dict("list"),
        "rmse": score["rmse"].tolist(),
        "stderr of rmse": score["stderr"].tolist(),
    }


def fit_kinematic():
    return _fit("kinematic")


def fit_lateral():
    return _fit("lateral", effects=["steering_delay"])


def fit_msnn():
    return _fit("msnn_lat", options=gb.FitOptions(strengths=1.0))


def gap():
    own = lap().rows(0, 300)
    found = gb.diagnose(
        "kinematic", own, vehicle="roboracer", effects=["steering_delay", "steering_lag", "mass_change"]
    )
    table = found.to_pandas()
    return {
        "probability": dict(zip(table["effect"], table["probability"], strict=True)),
        "magnitude": dict(zip(table["effect"], table["magnitude"], strict=True)),
        "closed": [found.gap.closed, *found.gap.closed_interval],
    }


def track():
    found = gb.track("lateral", lap().rows(0, 300), ["C_alpha_f", "C_alpha_r"], vehicle="roboracer",
                     options=gb.TrackOptions(tune=0.0))  # fmt: skip
    table = found.to_pandas().iloc[::25]
    return {name: table[name].astype(float).tolist() for name in table.columns if name not in ("time", "run")}


def profile():
    found = gb.profile(gb.fit("kinematic", lap(), vehicle="roboracer"), "yaw_lag")
    intervals = {"interval": list(found.interval), "noise alone": list(found.noise_alone.interval)}
    return {**intervals, "values": list(found.values), "rise": list(found.rise)}


def _rounded(found):
    value = float(found.group())
    return f"{value:.7g}" if abs(value) > EQUAL else "0"


def exports():
    """The code as it is written, but for the lines that name versions and commands."""
    found = {}
    for target in ("c", "casadi", "f1tenth"):
        with tempfile.TemporaryDirectory() as folder:
            for file in gb.export(gb.models.lateral(vehicle="roboracer"), f"{folder}/car", target=target):
                if file.suffix in (".c", ".py", ".yaml", ".h"):
                    text = file.read_text(encoding="utf-8")
                    kept = "\n".join(own for own in text.splitlines() if "greybox" not in own.lower())
                    alike = re.sub(
                        r"-?\d+\.\d{9,}(?:[eE][-+]?\d+)?", _rounded, kept
                    )  # processors differ in last digits
                    found[f"{target} {file.name}"] = sha256(alike.encode()).hexdigest()
    return found


CASES = {own.__name__: own for own in (fit_kinematic, fit_lateral, fit_msnn, gap, track, profile, exports)}


def plain(value):
    """Numbers of numpy as those of Python, NaN as a word."""
    if isinstance(value, dict):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    if isinstance(value, str):
        return value
    number = float(value)
    return number if math.isfinite(number) else repr(number)


def differences(wanted, found, where=""):
    """Where two differ, and by how much, relatively."""
    if isinstance(wanted, dict) and isinstance(found, dict):
        lost = [f"{where}: {key} is on one side only" for key in wanted.keys() ^ found.keys()]
        return lost + [
            d for key in wanted.keys() & found.keys() for d in differences(wanted[key], found[key], f"{where}/{key}")
        ]
    if isinstance(wanted, list) and isinstance(found, list):
        if len(wanted) != len(found):
            return [f"{where}: {len(wanted)} before, {len(found)} now"]
        return [d for k, own in enumerate(wanted) for d in differences(own, found[k], f"{where}[{k}]")]
    if isinstance(wanted, float) and isinstance(found, float):
        equal = math.isclose(wanted, found, rel_tol=EQUAL, abs_tol=1e-12)
        return [] if equal else [f"{where}: {wanted!r} before, {found!r} now"]
    return [] if wanted == found else [f"{where}: {wanted!r} before, {found!r} now"]


if __name__ == "__main__":
    numbers = {name: plain(own()) for name, own in CASES.items()}
    if "--write" in sys.argv:
        GOLDEN.write_text(json.dumps(numbers, indent=0, ensure_ascii=False) + "\n", encoding="utf-8")
    else:
        differ = differences(json.loads(GOLDEN.read_text(encoding="utf-8")), numbers)
        print("\n".join(differ) or "equal")
        sys.exit(bool(differ))
