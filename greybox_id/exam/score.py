"""Opening the answers, once: what was right, how often, and whether that is good enough."""

from __future__ import annotations

import json
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from datetime import UTC, datetime
from functools import partial
from math import nan
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from ..errors import BadInput
from ..files import write_atomically
from ..fitting import Say
from ..json_data import read_json, without_nan
from .answers import Answer, read_answer
from .findings import ExamFinding, finding
from .folder import CASES, DIAGNOSIS, SEALED, exam_of
from .measures import confusions, measures, sizes_by_effect
from .seal import unbroken
from .statistics import median
from .verification import Verify, held_out_closure

SCORE = "score.json"


def score(
    folder: Path, say: Say, *, verify: Verify = held_out_closure, jobs: int = 1, noted: str = ""
) -> tuple[dict[str, Any], bool]:
    """The score of an examination; answers and diagnoses are joined the first time only.

    Parameters
    ----------
    folder : of the examination.
    say : is told of progress.
    verify : how far a closed model closes the gap on the recording held out.
    jobs : processes that verify; with one, this process does.
    noted : the seal's sum as noted when the examination was made.

    Returns
    -------
    score : plain data, as in score.json.
    again : whether it had been opened before.

    Raises
    ------
    BadInput : the seal is broken, or a case has no diagnosis.
    """
    exam = exam_of(folder)
    seal = unbroken(exam, noted)
    if (exam / SCORE).is_file():
        return read_json(exam / SCORE), True
    about = read_json(exam / SEALED / "exam.json")
    answers = [read_answer(file) for file in sorted((exam / SEALED).glob("*/answer.json"))]
    lacking = [own.case for own in answers if not (exam / CASES / own.case / DIAGNOSIS).is_file()]
    if lacking:
        raise BadInput(
            f"{len(lacking)} of {len(answers)} cases have no diagnosis, {lacking[0]} first. A score is taken once: "
            f"run greybox exam run {exam / CASES} before."
        )
    diagnoses = {own.case: _diagnosis(exam / CASES / own.case / DIAGNOSIS) for own in answers}
    verified = _verified(exam, answers, diagnoses, verify, jobs, say)
    found = [finding(own, diagnoses[own.case], verified.get(own.case, nan)) for own in answers]
    body = {"tier": about["tier"], "version": about["version"], "seal": seal, **summary(found, about["tier"])}
    body["opened"] = datetime.now(UTC).isoformat(timespec="seconds")
    write_atomically(exam / SCORE, json.dumps(without_nan(body), indent=1) + "\n")
    return body, False


def summary(found: list[ExamFinding], tier: Any) -> dict[str, Any]:
    """Measures, confusions and single cases as plain data."""
    sizes = sizes_by_effect(found)
    return {
        "cases": len(found),
        "errors": sum(bool(own.error) for own in found),
        "measures": [asdict(own) | {"passed": own.passed} for own in measures(found, tier)],
        "confusions": confusions(found),
        "magnitudes": {
            name: {"median_error": median([own.error for own in some])[0], "covered": sum(own.covered for own in some),
                   "of": len(some)}
            for name, some in sizes.items()
        },
        "findings": [_plain(own) for own in found],
    }  # fmt: skip


def _plain(own: ExamFinding) -> dict[str, Any]:
    """A finding without what is sealed and long."""
    short: dict[str, Any] = {"case": own.answer.case, "kind": own.answer.kind, "effects": dict(own.answer.effects)}
    short["aliases"] = {name: list(alike) for name, alike in own.answer.aliases.items() if alike}
    short["size"] = own.answer.largest
    rest = {key: value for key, value in vars(own).items() if key not in ("answer", "sizes", "told", "choices")}
    choices = dict(list(own.choices.items())[:5])
    return {**short, "wrong": own.wrong, "choices": choices, "sizes": [asdict(size) for size in own.sizes], **rest}


def _diagnosis(file: Path) -> Mapping[str, Any]:
    body = read_json(file)
    if not isinstance(body, dict):
        raise BadInput(f"{file} holds no diagnosis. Take it out and run the case again.")
    return body


def _verified(
    exam: Path,
    answers: list[Answer],
    diagnoses: Mapping[str, Mapping[str, Any]],
    verify: Verify,
    jobs: int,
    say: Say,
) -> dict[str, float]:
    """Share of the gap that closes on the recording held out, for cases in which something was applied."""
    wanted = [
        own.case
        for own in answers
        if diagnoses[own.case].get("applied") and (exam / SEALED / own.case / "held_out.csv").is_file()
    ]
    one = partial(_verify, exam, verify)
    told = [diagnoses[case] for case in wanted]
    if jobs <= 1 or not wanted:
        shares = [one(*own) for own in zip(wanted, told, strict=True)]
    else:
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            shares = list(pool.map(one, wanted, told))
    say(f"{len(shares)} closed models verified on what was held out")
    return dict(zip(wanted, shares, strict=True))


def _verify(exam: Path, verify: Verify, case: str, diagnosis: Mapping[str, Any]) -> float:
    return verify(exam / CASES / case, exam / SEALED / case / "held_out.csv", diagnosis)
