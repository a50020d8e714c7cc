"""Recalibration of the numbers of a diagnosis: `python -m greybox_lab.exam.calibrate curves|thresholds|search`.

    curves                    distances of magic formulas from the tyre curves of the development families
    thresholds FOLDER ..      gains of nulls and of causes, and model errors, in development examinations
    search FOLDER .. --draws  verdicts with all numbers of the search randomly halved or doubled at once

FOLDER is an examination that was made, and for thresholds also diagnosed, with families that no examination
uses: `greybox exam make --tier foreign --family development`, or of any tier with a seed that is used for nothing
else. Answers are read, so such an examination proves nothing afterwards. Each part prints one JSON object.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields
from importlib import import_module
from math import log
from multiprocessing import get_context
from pathlib import Path
from shutil import copytree
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.optimize import curve_fit, minimize
from scipy.special import expit

from greybox_id.base.errors import BadInput
from greybox_id.base.json_data import read_json
from greybox_id.base.shorthands import Array
from greybox_id.gap.estimation.calibration import CAL, SEARCHED, Calibration

from .answers import Answer, read_answer
from .folder import CASES, DIAGNOSIS, SEALED, case_folders, exam_of

RARE = 0.02
"""Largest share of vehicles without a gap for which an effect is named."""
DIAGNOSER = "greybox_lab.cli.exam:diagnose_case"
SLIPS = (1.5, 2.4, 3.6)
"""Largest slip of drives, relative to the slip at which a linear tyre would reach its peak."""


def curves() -> dict[str, Any]:
    """RMS distance of the nearest magic formula with the same slope and peak, relative to the peak, by family."""
    from .foreign.double_track import TYRES, curve
    from .foreign.families import DEVELOPMENT

    def formula(s: Array, C: float, E: float) -> Array:
        x = s / C
        return np.asarray(np.sin(C * np.arctan(x - E * (x - np.arctan(x)))))

    result = dict[str, list[float]]()
    for name in DEVELOPMENT:
        for far in SLIPS:
            s = np.linspace(0, far, 200)[1:]
            true = np.array([curve(TYRES.index(name), each, 1.0, 1.0, 0.0) for each in s])
            near, _ = curve_fit(formula, s, true, (1.3, 0.3), bounds=((1.01, -10), (2.5, 1)))
            off = formula(s, *near) - true
            result.setdefault(name, []).append(_round(np.sqrt(np.mean(off**2))))
    return {"slips": SLIPS, "off": result, "used": CAL.curve_off}


def thresholds(folders: Sequence[Path]) -> dict[str, Any]:
    """Gains of nulls and of causes, and the model error at which an unmodelled effect has probability one half.

    `cost` is derived from nulls' largest gains with an exponential tail: one in fifty gains as much.
    """
    read = [item for folder in folders for item in _read(folder)]
    nulls = np.array([_gain(item) for answer, item in read if answer.kind == "null"])
    causes = [_gain(item, answer.alike(name)) for answer, item in read
              if answer.kind in ("single", "double") and answer.sizable for name in answer.effects]  # fmt: skip
    shares, named = [], []
    for answer, item in read:
        if answer.kind in ("null", "outside") and item.get("model_error"):
            shares.append(max(float(item["share"]) for item in item["model_error"].values()) / CAL.form)
            named.append(answer.kind == "outside")
    body: dict[str, Any] = {"nulls": len(nulls), "causes": len(causes), "used": {"cost": CAL.cost}}
    if len(nulls):
        middle = float(np.median(nulls))
        tail = float(np.mean(nulls[nulls > middle] - middle)) if np.any(nulls > middle) else 0.0
        body["cost"] = {"greatest": sorted(nulls.round(1).tolist(), reverse=True)[:5], "median": middle,
                        "one in fifty": middle + tail * log(0.5 / RARE)}  # fmt: skip
    if causes:
        body["causes gain"] = {
            "least": sorted(round(cause, 1) for cause in causes)[:5],
            "median": float(np.median(causes)),
        }
    if any(named) and not all(named):
        body["unnamed"] = _halfway(np.log(shares), np.array(named))
    return body


def search(folders: Sequence[Path], draws: int, seed: int, jobs: int, diagnoser: str) -> dict[str, Any]:
    """Differences of verdicts and magnitudes when every number of the search is randomly halved, kept or doubled.

    Parameters
    ----------
    folders : examinations, whose cases are all diagnosed with each draw.
    draws : number of draws of all numbers together.
    seed : of the draws.
    jobs : number of parallel processes.
    diagnoser : "module:function", as in `exam.run`.
    """
    cases = [case for folder in folders for case in case_folders(exam_of(folder))]
    changes = [{}, *_drawn(draws, seed)]
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        requested = [(change, case) for change in changes for case in cases]
        stated = list[dict[str, Any]]()
        for item in pool.map(_diagnosed, *zip(*((item, case, diagnoser) for item, case in requested), strict=True)):
            stated.append(item)
            print(
                f"{len(stated)} of {len(requested)}: {requested[len(stated) - 1][1].name}  {_words(item)}",
                file=sys.stderr,
                flush=True,
            )
    usual, rest = stated[: len(cases)], stated[len(cases) :]
    rows = list[dict[str, Any]]()
    for k, change in enumerate(changes[1:]):
        for case, before, then in zip(cases, usual, rest[k * len(cases) :], strict=False):
            answer = read_answer(case.parents[1] / SEALED / case.name / "answer.json")
            rows.append({"draw": k, "case": case.name, **_differs(before, then, answer)})
        rows[-1]["numbers"] = change
    moved = [row["moved"] for row in rows if row["moved"] is not None]
    return {
        "numbers": len(_searched()), "draws": draws, "cases": len(cases), "seed": seed,
        "verdicts changed": sum(row["verdict"] for row in rows), "of": len(rows),
        "shift of magnitudes over half the interval": {"median": _round(np.median(moved)), "most": _round(max(moved))}
        if moved else None, "cpu": [round(sum(one["cpu"] for one in stated[k * len(cases) : (k + 1) * len(cases)]), 1)
                                    for k in range(len(changes))],
        "rows": [row for row in rows if row["verdict"]],
    }  # fmt: skip


def _words(stated: Mapping[str, Any]) -> str:
    return f"{', '.join(stated['applied']) or 'nothing'}, {stated['cpu']:.0f} CPU s"


def _searched() -> list[str]:
    return [field.name for field in fields(Calibration) if field.metadata["data"] == SEARCHED]


def _drawn(draws: int, seed: int) -> list[dict[str, Any]]:
    """Random changes of the search's numbers: halved or doubled, grids by a factor 2^(1/4)."""
    rng, result = np.random.default_rng(seed), []
    for _ in range(draws):
        change = dict[str, Any]()
        for name in _searched():
            value, power = getattr(CAL, name), int(rng.integers(-1, 2))
            if isinstance(value, tuple):
                change[name] = tuple(item if item in (0.0, 1.0) else item * 2.0 ** (power / 4) for item in value)
            elif isinstance(value, int):
                change[name] = max(1, round(value * 2.0**power))
            else:
                change[name] = value * 2.0**power
        result.append(change)
    return result


def _diagnosed(change: Mapping[str, Any], case: Path, diagnoser: str) -> dict[str, Any]:
    """Diagnosis of a case with changed numbers; runs in a process of its own, which has used none of them before."""
    from time import process_time

    for name, value in change.items():
        object.__setattr__(CAL, name, value)
    module, _, function = diagnoser.partition(":")
    diagnose = getattr(import_module(module), function)
    start = process_time()
    with TemporaryDirectory() as folder:
        body = diagnose(copytree(case, Path(folder) / case.name))
    kept = [{key: item[key] for key in ("effect", "magnitude", "interval", "gain")} for item in body["ranking"][:8]]
    return {
        "applied": sorted(body["applied"]),
        "gap": body["gap_detected"],
        "ranking": kept,
        "cpu": process_time() - start,
    }


def _differs(before: Mapping[str, Any], then: Mapping[str, Any], answer: Answer) -> dict[str, Any]:
    """Whether the verdict differs up to indistinguishable names, and largest shift of a magnitude in half intervals."""
    names = [{min(answer.alike(name)) for name in item["applied"]} for item in (before, then)]
    same = names[0] == names[1] and before["gap"] == then["gap"]
    there = {item["effect"]: item for item in then["ranking"]}
    moved = [0.0]
    for item in before["ranking"]:
        if item["effect"] in before["applied"] and item["effect"] in there:
            low, high = item["interval"]
            moved.append(2 * abs(there[item["effect"]]["magnitude"] - item["magnitude"]) / max(high - low, 1e-12))
    stated = {"from": before["applied"], "to": then["applied"]} if not same else {}
    return {"verdict": not same, "moved": max(moved) if before["applied"] and same else None, **stated}


def _read(folder: Path) -> Iterator[tuple[Answer, dict[str, Any]]]:
    """Answers and diagnoses of the diagnosed cases."""
    exam = exam_of(folder)
    for file in sorted((exam / SEALED).glob("*/answer.json")):
        diagnosis = exam / CASES / file.parent.name / DIAGNOSIS
        if diagnosis.is_file():
            yield read_answer(file), read_json(diagnosis)


def _gain(result: Mapping[str, Any], names: frozenset[str] | None = None) -> float:
    """The largest gain of some effects, or of all if none are named."""
    ranking = (item for item in result.get("ranking", ()) if names is None or item["effect"] in names)
    return max((float(item["gain"]) for item in ranking), default=0.0)


def _halfway(x: Array, there: Array) -> dict[str, float]:
    """Midpoint and slope of a logistic curve; a weak prior keeps them finite (Gelman et al., 2008)."""
    shift, scale = float(np.mean(x)), float(np.std(x)) or 1.0
    u = (x - shift) / scale

    def loss(p: Array) -> float:
        odds = p[0] + p[1] * u
        value = np.sum(np.logaddexp(0, odds) - there * odds)
        return float(value + 2.5 * np.log1p((p[1] / 2.5) ** 2) / 2 + 0.005 * p[0] ** 2)

    a, b = minimize(loss, np.array([0.0, 1.0])).x
    at = float(np.exp(shift - scale * a / b)) if b else float("nan")
    error = float(np.mean((expit(a + b * u) > 0.5) != there))
    return {"share": _round(at), "slope": _round(b / scale), "wrong": _round(error), "of": len(x)}


def _round(x: float) -> float:
    return float(f"{float(x):.3g}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the numbers of one part."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=("curves", "thresholds", "search"))
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--draws", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--diagnoser", default=DIAGNOSER)
    options = parser.parse_args(arguments)
    if options.part != "curves" and not options.folders:
        parser.error(f"{options.part} needs the folders of examinations for development")
    try:
        if options.part == "curves":
            body = curves()
        elif options.part == "thresholds":
            body = thresholds(options.folders)
        else:
            body = search(options.folders, options.draws, options.seed, options.jobs, options.diagnoser)
    except BadInput as error:
        parser.error(str(error))
    print(json.dumps(body, indent=1))


if __name__ == "__main__":
    main()
