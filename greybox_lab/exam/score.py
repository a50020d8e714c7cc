"""Opening of the answers, once: how often diagnoses were right, and whether that passes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any

from rich.table import Table

from greybox_id.base.errors import BadInput
from greybox_id.base.files import write_atomically
from greybox_id.base.json_data import read_json, without_nan
from greybox_id.base.numbers import number
from greybox_id.base.processes import side_by_side
from greybox_id.fitting.how import Say
from greybox_id.reports.text.screen import plain_table

from .answers import Answer, read_answer
from .findings import ExamFinding, finding
from .folder import CASES, DIAGNOSIS, SEALED, exam_of, unbroken
from .measures import STRETCH, confusions, measures, median, sizes_by_effect
from .verification import Verify, held_out_closure, true_closure

SCORE = "score.json"


def score(
    folder: Path, say: Say, *, verify: Verify = held_out_closure, jobs: int = 1, noted: str = "", partial: bool = False
) -> tuple[dict[str, Any], bool]:
    """The score of an examination; answers and diagnoses are compared the first time only.

    Parameters
    ----------
    folder : of the examination.
    say : called with progress.
    verify : share of the gap that a closed model closes on the held-out recording.
    jobs : number of verifying processes; with one, this process does it.
    noted : the seal's checksum as noted when the examination was made.
    partial : score only the diagnosed cases, such as a sample; the score is not stored.

    Returns
    -------
    score : plain data, as in score.json.
    again : whether it had been opened before.

    Raises
    ------
    BadInput : if the seal is broken, or a case has no diagnosis.
    """
    exam = exam_of(folder)
    seal = unbroken(exam, noted)
    if (exam / SCORE).is_file():
        return read_json(exam / SCORE), True
    about = read_json(exam / SEALED / "exam.json")
    answers = [read_answer(file) for file in sorted((exam / SEALED).glob("*/answer.json"))]
    lacking = [answer.case for answer in answers if not (exam / CASES / answer.case / DIAGNOSIS).is_file()]
    answers = [answer for answer in answers if answer.case not in lacking] if partial else answers
    if lacking and not (partial and answers):
        raise BadInput(
            f"{len(lacking)} of {len(answers)} cases have no diagnosis, {lacking[0]} first. An examination is "
            f"scored once: first run greybox exam run {exam / CASES}, or score what is diagnosed with --partial."
        )
    diagnoses = {answer.case: _diagnosis(exam / CASES / answer.case / DIAGNOSIS) for answer in answers}
    verified = _verified(exam, answers, diagnoses, verify, jobs, say)
    result = [finding(answer, diagnoses[answer.case], *verified.get(answer.case, (nan, nan))) for answer in answers]
    body = {"tier": about["tier"], "version": about["version"], "seal": seal, **summary(result, about["tier"])}
    body["opened"] = datetime.now(UTC).isoformat(timespec="seconds")
    if not partial:
        write_atomically(exam / SCORE, json.dumps(without_nan(body), indent=1) + "\n")
    return body, False


def summary(exam_findings: list[ExamFinding], tier: Any) -> dict[str, Any]:
    """Measures, confusions and single cases as plain data."""
    sizes = sizes_by_effect(exam_findings)
    return {
        "cases": len(exam_findings),
        "errors": sum(bool(item.error) for item in exam_findings),
        "measures": [asdict(measure) | {"passed": measure.passed} for measure in measures(exam_findings, tier)],
        "confusions": confusions(exam_findings),
        "magnitudes": {
            name: {"median_error": median([one.error for one in some])[0], "covered": sum(one.covered for one in some),
                   "of": len(some)}
            for name, some in sizes.items()
        },
        "findings": [_plain(item) for item in exam_findings],
    }  # fmt: skip


def _plain(exam_finding: ExamFinding) -> dict[str, Any]:
    """A finding without its long sealed parts."""
    short: dict[str, Any] = {
        "case": exam_finding.answer.case,
        "kind": exam_finding.answer.kind,
        "effects": dict(exam_finding.answer.effects),
    }
    short["aliases"] = {name: list(alike) for name, alike in exam_finding.answer.aliases.items() if alike}
    short["size"] = exam_finding.answer.largest
    rest = {
        key: value for key, value in vars(exam_finding).items() if key not in ("answer", "sizes", "ranked", "choices")
    }
    choices = dict(list(exam_finding.choices.items())[:5])
    return {
        **short,
        "wrong": exam_finding.wrong,
        "choices": choices,
        "sizes": [asdict(size) for size in exam_finding.sizes],
        **rest,
    }


def _diagnosis(file: Path) -> Mapping[str, Any]:
    body = read_json(file)
    if not isinstance(body, dict):
        raise BadInput(f"{file} holds no diagnosis. Remove it and run the case again.")
    return body


def _verified(
    exam: Path,
    answers: list[Answer],
    diagnoses: Mapping[str, Mapping[str, Any]],
    verify: Verify,
    jobs: int,
    say: Say,
) -> dict[str, tuple[float, float]]:
    """Share of the gap that closes on the held-out recording, by applied effects and, for many, by present effects."""
    target = [
        answer
        for answer in answers
        if (diagnoses[answer.case].get("applied") or answer.kind == "many")
        and (exam / SEALED / answer.case / "held_out.csv").is_file()
    ]

    def one(number: int) -> tuple[float, float]:
        value = target[number]
        given, held_out, stated = (
            exam / CASES / value.case,
            exam / SEALED / value.case / "held_out.csv",
            diagnoses[value.case],
        )
        by_truth = true_closure(given, held_out, value) if value.kind == "many" else nan
        return verify(given, held_out, stated) if stated.get("applied") else nan, by_truth

    done = side_by_side(one, len(target), jobs)
    if done.interrupted:
        raise KeyboardInterrupt
    say(f"{len(target)} closed models verified on held-out recordings")
    return {item.case: both for item, both in zip(target, done.results, strict=True)}


PLAIN = ("changed_off", "extra", "classes", "closed", "claim", "calibration", "cpu")
"""Measures that are not shown in per cent."""
MARKS = {True: "✓", False: "✗", None: ""}


def score_table(body: Mapping[str, Any]) -> Table:
    """Every measure with its interval, number of cases, and bar."""
    numbers = ("measured", "95 % interval", "of", "bar")
    table = plain_table("what", *numbers, "", right=numbers)
    for one in body["measures"]:
        percent = one["key"] not in PLAIN
        low, high = one["interval"]
        interval = f"[{_number(low, percent, bare=True)}, {_number(high, percent, bare=True)}]"
        table.add_row(
            one["name"],
            _number(one["value"], percent) if one["of"] else "–",
            interval if _there(low) and _there(high) else "–",
            str(one["of"]),
            bar_words(one["bar"], percent) + (f", better {STRETCH:g}" if one["key"] == "cpu" and one["bar"] else ""),
            MARKS[one["passed"]],
        )
    return table


def bar_words(bar: tuple[float, float] | None, percent: bool) -> str:
    """A bar in readable notation."""
    if bar is None:
        return ""
    low, high = (inf if item is None else float(item) for item in bar)
    unit = " %" if percent else ""
    scale = 100.0 if percent else 1.0
    if low == 0.0:
        return f"≤ {high * scale:g}{unit}"
    if high == (1.0 if percent else inf):
        return f"≥ {low * scale:g}{unit}"
    return f"{low * scale:g}–{high * scale:g}{unit}"


def confusions_table(body: Mapping[str, Any]) -> Table:
    """First choices by true effect, and accuracy of magnitudes."""
    table = plain_table("effect", "first choices", "magnitude off", "covered", right=("magnitude off", "covered"))
    for true, choices in body["confusions"].items():
        words = ", ".join(f"{'right' if name == true else name} {count}" for name, count in choices.items())
        size = body["magnitudes"].get(true)
        off = _number(size["median_error"], True) if size else ""
        table.add_row(true, words, off, f"{size['covered']}/{size['of']}" if size else "")
    return table


def wrong_table(body: Mapping[str, Any]) -> Table:
    """Cases with a mistake or an absent effect; real changes always."""
    table = plain_table("case", "truth", "size", "wrong", "first choices", right=("size",))
    for one in body["findings"]:
        if not _worth_telling(one):
            continue
        known = [f"{name} {number(value, 3)}" if _there(value) else name for name, value in one["effects"].items()]
        truth = ", ".join(known) or one["kind"]
        choices = ", ".join(f"{name} {value:.2f}" for name, value in list(one["choices"].items())[:3] if _there(value))
        unknown = one["unknown_probability"]
        if _there(unknown) and unknown > 0.05:
            choices += f"{', ' if choices else ''}unknown {unknown:.2f}"
        what = one["error"] or one["wrong"] or ("gap" if one["detected"] else "no gap")
        if one["beside"]:
            what += f", {', '.join(one['beside'])} applied"
        table.add_row(one["case"], truth, f"{number(one['size'], 2)}", what, choices)
    return table


def tables(body: Mapping[str, Any], detail: bool) -> Iterator[Table]:
    """The printed tables of a score."""
    yield score_table(body)
    if detail:
        yield confusions_table(body)
        if any(_worth_telling(item) for item in body["findings"]):
            yield wrong_table(body)


def _worth_telling(value: Mapping[str, Any]) -> bool:
    """Whether a case is listed: it has a mistake, or is real."""
    return bool(value["wrong"] or value["beside"]) or value["kind"] == "changed"


def _there(value: float | None) -> bool:
    return value is not None and isfinite(value)


def _number(value: float | None, percent: bool, bare: bool = False) -> str:
    if value is None or not isfinite(value):
        return "–" if value is None or value != -inf else "−∞"
    if percent:
        return f"{100 * value:.1f}{'' if bare else ' %'}"
    return f"{value:.3f}"
