"""Comparison of several fits: what each is, their errors on the same recordings, and whether the errors differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..base.numbers import counted, listed, number, percent, pretty_unit, quoted, signal_words, the_recordings
from ..base.numbers import interval as interval_of
from ..base.shorthands import Array, Index
from ..base.signals import SIGNALS, unit_of
from ..base.statistics import correlation_time, resampled
from ..datasets.recording import Recording
from ..engine.simulation import Prediction
from ..fitting.fit import Fit
from ..fitting.scores.metrics import FREE_RUN
from .content import heading
from .document import Document, Drawing, Pairs, Part, Table, Text, VerdictBox, titled
from .figures.sheet import BLUE, DASHED, DOTTED, INK, ORANGE, PURPLE, RUST, label, look, sheet_of
from .report import seen

DRAWS = 2000
"""Number of bootstrap draws of blocks, with replacement, per interval."""
LEAST_SECONDS, TIMES = 1.0, 4.0
"""Shortest length of a block, s, and length in correlation times of the difference of squared errors."""
LEAST_BLOCKS = 6
"""Least number of blocks for an interval."""

Judged = Mapping[str, tuple[tuple[Recording, tuple[str, ...], Prediction], ...]]
"""Protocol -> (recording, outputs, predictions) of each recording."""


@dataclass(frozen=True)
class Paired:
    """Errors of two fits on the same rows.

    Attributes
    ----------
    first, second : RMSE in the output's unit.
    low, high : 95 % interval of second minus first, from a bootstrap over paired blocks; NaN if there are too few.
    seconds : length of a block.
    blocks : number of blocks.
    """

    first: float
    second: float
    low: float
    high: float
    seconds: float
    blocks: int

    @property
    def significant(self) -> bool:
        """Whether the interval excludes zero."""
        return bool(np.isfinite(self.low) and (self.low > 0 or self.high < 0))


def paired(first: Array, second: Array, run: Array, sample_time: float) -> Paired:
    """Errors of two models on the same rows, and an interval of the difference of their RMSE.

    Parameters
    ----------
    first, second : (n,) errors.
    run : (n,) number of each row's run.
    sample_time : s.
    """
    first_squares, second_squares = first**2, second**2
    centred = second_squares - first_squares - np.mean(second_squares - first_squares)
    length = max(round(LEAST_SECONDS / sample_time), round(TIMES * correlation_time(centred[:, None])), 1)
    blocks: list[tuple[float, float, int]] = []
    for number_ in np.unique(run):
        rows = np.flatnonzero(run == number_)
        count = max(1, len(rows) // length)
        blocks += [
            (float(first_squares[part].sum()), float(second_squares[part].sum()), len(part))
            for part in np.array_split(rows, count)
        ]
    low, high = resampled(np.array(blocks), _difference, DRAWS) if len(blocks) >= LEAST_BLOCKS else (np.nan, np.nan)
    return Paired(
        float(np.sqrt(first_squares.mean())), float(np.sqrt(second_squares.mean())), float(low), float(high),
        length * sample_time, len(blocks),
    )  # fmt: skip


def _difference(sums: Array) -> float:
    """Difference of two RMSE, from sums of squares and their count."""
    return float(np.diff(np.sqrt(sums[:2] / sums[2]))[0])


def pairs_of(first: Judged, second: Judged) -> dict[tuple[str, str], Paired]:
    """(output, protocol) -> errors of both fits, for outputs and protocols that both predict."""
    result = {}
    for protocol in (name for name in first if name in second and name != "published"):
        outputs = dict.fromkeys(name for _, names, _ in first[protocol] for name in names)
        for output in outputs:
            parts = [
                _together(output, one, other)
                for one, other in zip(first[protocol], second[protocol], strict=True)
                if output in one[1] and output in other[1]
            ]
            parts = [part for part in parts if len(part[0])]
            if parts:
                runs = np.concatenate([part[2] + 1000 * k for k, part in enumerate(parts)])
                first_errors, second_errors = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
                result[output, protocol] = paired(first_errors, second_errors, runs, first[protocol][0][0].sample_time)
    return result


def _together(
    output: str,
    one: tuple[Recording, tuple[str, ...], Prediction],
    other: tuple[Recording, tuple[str, ...], Prediction],
) -> tuple[Array, Array, Index]:
    """Errors of both on the rows that both predict, and the rows' runs."""
    errors = []
    for _, outputs, item in (one, other):
        k = outputs.index(output)
        errors.append((item.rows, item.predicted[:, k] - item.measured[:, k], item.run))
    _, at, also = np.intersect1d(errors[0][0], errors[1][0], return_indices=True)
    first, second, run = errors[0][1][at], errors[1][1][also], errors[0][2][at]
    finite = np.isfinite(first) & np.isfinite(second)
    return first[finite], second[finite], run[finite]


COLOURS = (INK, BLUE, ORANGE, PURPLE, RUST)

OWN_PREDICTIONS = "closed_loop"


@dataclass(frozen=True)
class NamedFit:
    """A fit with its name in the comparison and the recordings it was fitted to or scored on."""

    name: str
    fit: Fit
    recordings: tuple[Recording, ...]


def comparison(fits: Sequence[NamedFit]) -> Document:
    """A report that compares several fits.

    Raises
    ------
    BadInput : if a recording of a fit is missing.
    """
    role = common_role(fits)
    parts: tuple[Part, ...]
    if role is None:
        parts = (VerdictBox((("Not compared", _apart(fits)),)), *titled("The fits", _described(fits)))
        return _document(fits, parts)
    result = {fit.name: _judged(fit, role) for fit in fits}
    base = fits[0].name
    pairs = {fit.name: pairs_of(result[base], result[fit.name]) for fit in fits[1:]}
    where = the_recordings([record.name for record in fits[0].fit.data if record.role == role])
    judged = f"{where}{', which they were fitted to' if role == 'train' else ' (held out)'}"
    words = (
        f"Differences are the RMSE minus that of {base}, over the rows that both predict. Their 95 % intervals come "
        f"from {DRAWS} draws of blocks of time, the same blocks for both fits; a block lasts {TIMES:g} correlation "
        "times of the difference of squared errors. A * marks a difference whose interval excludes zero."
    )
    parts = (
        VerdictBox(tuple(_sentence(name, base, pair, judged) for name, pair in pairs.items())),
        *titled("The fits", _described(fits)),
        *titled(
            "Errors on the same recordings",
            *_drawn(result),
            *(_table(base, *pair) for pair in pairs.items()),
            Text(words),
        ),
        *titled("Their commands", _commands(fits)),
    )
    return _document(fits, parts)


def common_role(fits: Sequence[NamedFit]) -> str | None:
    """The role of files that all fits share: validate, or train if none of them was validated; None if none."""
    validated = any(record.role == "validate" for fit in fits for record in fit.fit.data)
    role = "validate" if validated else "train"
    seen_by = [[d.sha256 or d.name for d in fit.fit.data if d.role == role] for fit in fits]
    same = all(seen_by) and all(sorted(one) == sorted(other) for one, other in pairwise(seen_by))
    return role if same else None


def _judged(named_fit: NamedFit, role: str) -> Judged:
    predicted = seen(named_fit.fit.model, named_fit.fit, named_fit.recordings)
    result: dict[str, list[tuple[Recording, tuple[str, ...], Prediction]]] = {}
    for one in sorted((one for one in predicted if one.role == role), key=lambda one: one.recording.source.sha256):
        for protocol, prediction in one.predicted.items():
            name = FREE_RUN if protocol == OWN_PREDICTIONS else protocol
            result.setdefault(name, []).append((one.recording, one.outputs, prediction))
    return {name: tuple(parts) for name, parts in result.items()}


def _sentence(name: str, base: str, pairs: Mapping[tuple[str, str], Paired], judged: str) -> tuple[str, str]:
    """Differences of a fit from the first in free run, or in the first protocol that both have."""
    protocols = dict.fromkeys(protocol for _, protocol in pairs)
    if not protocols:
        return name, (
            f"The errors are not compared with those of {base}: the two fits make no predictions of the same kind."
        )
    main = FREE_RUN if FREE_RUN in protocols else next(iter(protocols))
    clauses = []
    for (output, protocol), pair in pairs.items():
        if protocol == main:
            ratio = pair.second / pair.first if pair.first > 0 else float("nan")
            size = percent(abs(ratio - 1.0))
            word = f"{size} {'larger' if ratio > 1 else 'smaller'}" if pair.significant else "no different"
            clauses.append(f"{word if np.isfinite(pair.low) else 'indistinguishable'} in {signal_words(output)}")
    how = "in free run" if main == FREE_RUN else _protocol(main)
    return name, f"On {judged}, its errors {how} compare with those of {base} as follows: {listed(clauses)}."


def _table(base: str, name: str, pairs: Mapping[tuple[str, str], Paired]) -> Table:
    head = ("output", "prediction", base, name, "difference", "95 % interval", "blocks")
    rows, before = [], ""
    outputs = list(dict.fromkeys(output for output, _ in pairs))
    for (output, protocol), item in sorted(pairs.items(), key=lambda pair: outputs.index(pair[0][0])):
        words = f"{signal_words(output)} [{pretty_unit(unit_of(output))}]"
        interval = (
            interval_of(item.low, item.high, (item.high - item.low) / 4) if np.isfinite(item.low) else "too few blocks"
        )
        rows.append(
            (
                words if words != before else "", _protocol(protocol), number(item.first), number(item.second),
                number(item.second - item.first, 2), interval + (" *" if item.significant else ""),
                f"{item.blocks} of {item.seconds:.1f} s",
            )
        )  # fmt: skip
        before = words
    return Table(head, tuple(rows), "lLrrrrr")


def _protocol(name: str) -> str:
    return {"honest": "one sample ahead"}.get(name, name)


def _drawn(result: Mapping[str, Judged]) -> tuple[Drawing, ...]:
    """A panel per output that several fits predict: RMSE of each fit over the protocols."""
    step = next(parts[0][0].sample_time for item in result.values() for parts in item.values())
    seconds = {p: _seconds(p, step) for item in result.values() for p in item if p != "published"}
    protocols = sorted(seconds, key=lambda protocol: seconds[protocol])
    predicted = [{n for parts in item.values() for _, ns, _ in parts for n in ns} for item in result.values()]
    outputs = [name for name in SIGNALS if sum(name in item for item in predicted) > 1]
    if not outputs:
        return ()
    sheet, axes = sheet_of(len(outputs), 4, 100.0)
    for ax, output in zip(axes, outputs, strict=True):
        for k, (name, item) in enumerate(result.items()):
            at = [j for j, p in enumerate(protocols) if any(output in ns for _, ns, _ in item.get(p, ()))]
            rmse = [_rmse(output, item[protocols[j]]) for j in at]
            colour, dashes = COLOURS[k % len(COLOURS)], ("-", DASHED, DOTTED)[k % 3]
            ax.plot(at, rmse, **look(colour, 1.1, name, dashes=dashes, dots=1.7))
        ax.set(xlabel="horizon [s]", xlim=(-0.4, len(protocols) - 0.6), title=signal_words(output),
               ylabel=label("RMSE", unit_of(output)))  # fmt: skip
        ax.set_xticks(
            range(len(protocols)), [f"{seconds[p]:g}" if np.isfinite(seconds[p]) else "free" for p in protocols]
        )
        ax.set_ylim(bottom=0.0)
    caption = "RMSE of every fit on the same recordings by horizon of prediction, over all rows that the fit predicts."
    return (Drawing("comparison", sheet, caption, "Errors of all fits by horizon."),)


def _seconds(protocol: str, step: float) -> float:
    """Horizon of a protocol, s; infinite for free run."""
    return step if protocol == "honest" else np.inf if protocol == FREE_RUN else float(protocol.split(" ", 1)[0])


def _rmse(output: str, parts: Sequence[tuple[Recording, tuple[str, ...], Prediction]]) -> float:
    errors = [
        item.predicted[:, names.index(output)] - item.measured[:, names.index(output)]
        for _, names, item in parts
        if output in names
    ]
    return float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2)))


def _described(fits: Sequence[NamedFit]) -> Table:
    rows = []
    for fit in fits:
        model = fit.fit.model
        free = sum(p.size for p in model.parameters if not p.fixed)
        trained = [d.name for d in fit.fit.data if d.role == "train"]
        judged = [d.name for d in fit.fit.data if d.role == "validate"]
        rows.append(
            (
                fit.name, model.name, ", ".join(model.effects) or "none", counted(free, "free parameter"),
                listed(trained), listed(judged) or "none", _converged(fit.fit),
            )
        )  # fmt: skip
    return Table(("fit", "model", "effects", "size", "trained on", "scored on", "converged"), tuple(rows), "llLllll")


def _converged(fit: Fit) -> str:
    if not fit.stages:
        return "not fitted here"  # an imported network
    return "yes" if fit.stages[-1].converged else "no"


def _commands(fits: Sequence[NamedFit]) -> Pairs:
    commands = tuple((fit.name, fit.fit.command or "not recorded (fitted from Python)") for fit in fits)
    return Pairs(commands, code=tuple(fit.name for fit in fits))


def _apart(fits: Sequence[NamedFit]) -> str:
    judged = [
        f"{fit.name} on {listed(quoted([d.name for d in fit.fit.data if d.role == 'validate'])) or 'none'}"
        for fit in fits
    ]
    return (
        "The errors of the fits cannot be compared, since the fits were scored on different held-out recordings: "
        f"{listed(judged)}. Fit them with the same validation recording, or validate them on one recording."
    )


def _document(fits: Sequence[NamedFit], parts: tuple[Part, ...]) -> Document:
    about = listed([fit.name for fit in fits])
    versions = listed(sorted({fit.fit.version for fit in fits}))
    cars = {str(fit.fit.how.get("vehicle") or "") for fit in fits}
    of = f"{len(fits)} fits of {car}" if len(cars) == 1 and (car := next(iter(cars))) else f"{len(fits)} fits"
    data = {one.sha256 or one.name: one for fit in fits for one in fit.fit.data if one.role == "train"}
    return Document(heading("Comparison", of, [*data.values()]), about, "several fits", f"greybox-id {versions}", parts)
