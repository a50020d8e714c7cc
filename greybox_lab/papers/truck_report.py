"""The tables and figures of the transfer-learning paper, measured anew: as a document, and for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from greybox_id.base.numbers import number, with_sd
from greybox_id.base.version import __version__
from greybox_id.reports.document import Document, Drawing, Part, Points, Table, Text, titled
from greybox_id.reports.figures.sheet import (
    BLUE,
    CHAIN,
    DASHED,
    DOTTED,
    MEASURED,
    ORANGE,
    PURPLE,
    RUST,
    Look,
    Sheet,
    band,
    label,
    look,
)

from .truck_networks import BEYOND, FASTER, WORDS

UNITS = {"v_y": "m/s", "yaw_rate": "rad/s"}
COLOURS = (BLUE, ORANGE, PURPLE, RUST)
DASHES = ("-", DASHED, CHAIN, DOTTED)


def looks(names: Sequence[str]) -> dict[str, Look]:
    """How models are drawn, in their order."""
    return {
        name: look(COLOURS[k % len(COLOURS)], 1.1, name, dashes=DASHES[k % len(DASHES)]) for k, name in enumerate(names)
    }


def over_durations(durations: Sequence[Mapping[str, Any]]) -> Sheet:
    """Fig. 3: RMSE of free runs over how long they have run, by output."""
    sheet = Sheet((120.0,), len(UNITS))
    lines = looks([duration["model"] for duration in durations])
    for ax, (output, unit) in zip(sheet.grid[0], UNITS.items(), strict=True):
        for duration in durations:
            ax.plot(
                duration["seconds"], duration[output], **lines[duration["model"]] | {"marker": "o", "markersize": 2.4}
            )
        ax.set(xlabel="time since the start [s]", ylabel=f"RMSE of {label(output, unit)}", ylim=(0.0, None))
    return sheet


def slalom(traces: Mapping[str, Any]) -> Sheet:
    """Fig. 4: a slalom, measured and predicted, with 95 % bands: a row of axes for each method."""
    lines = looks([trace["model"] for trace in traces["lines"]])
    sheet = Sheet((80.0,) * len(lines), len(UNITS), joined=True)
    seconds = np.array(traces["seconds"])
    for row, trace in zip(sheet.grid, traces["lines"], strict=True):
        line = lines[trace["model"]]
        for ax, (output, unit) in zip(row, UNITS.items(), strict=True):
            mean, reach = np.array(trace[output]), np.array(trace[f"{output}_reach"])
            band(ax, seconds, mean - reach, mean + reach, line["color"])
            ax.plot(seconds, traces["measured"][output], **MEASURED)
            ax.plot(seconds, mean, **line)
            ax.set_ylabel(label(output, unit))
    for ax in sheet.grid[-1]:
        ax.set_xlabel("time since the start [s]")
    return sheet


def learning_curves(curves: Sequence[Mapping[str, Any]]) -> Sheet:
    """RMSE on val over the share of the training recordings, and what transfer makes of it with 95 % intervals."""
    sheet = Sheet((110.0, 90.0), len(UNITS), joined=True)
    lines = {"learning": look(ORANGE, 1.1, "MLP", dashes=DASHED, dots=1.6),
             "transfer": look(BLUE, 1.1, "MLP, transfer learning", dots=1.6)}  # fmt: skip
    for column, (output, unit) in zip(sheet.grid.T, UNITS.items(), strict=True):
        value = [each for each in curves if each["output"] == output]
        share = 100 * np.array([each["share"] for each in value])
        for method, line in lines.items():
            column[0].plot(share, [each[method] for each in value], **line)
        column[0].set(ylabel=f"RMSE of {label(output, unit)}", ylim=(0.0, None))
        ratio, low, high = (np.array([each[name] for each in value]) for name in ("ratio", "low", "high"))
        column[1].axhline(1.0, color=MEASURED["color"], linewidth=0.6)
        band(column[1], share, low, high)
        column[1].plot(share, ratio, **lines["transfer"])
        column[1].set(xlabel="share of the training recordings [%]", ylabel="with transfer over without")
    return sheet


Found = Mapping[str, Any]
BICYCLES = ("bicycle, signs as published", "bicycle, signs corrected, lever arm")
"""Grey boxes of Fig. 3, beside networks."""
OUT_OF_RANGE = (
    "Models are trained and stopped on trajectories below 60 km/h, and scored on trajectories of other recordings "
    f"with a mean speed above 70 km/h. Intervals are over recordings. Networks named “{FASTER}” are also "
    "trained on simulations of the "
    f"bicycle at up to {BEYOND:g} times the fastest of these speeds."
)
PAIRED = (
    "The difference of the RMSE is taken trajectory by trajectory; if its interval includes zero, it is not "
    "significant."
)
PROTOCOLS = (
    "as published: chunks of one recording of the truck lie in train and val. Networks are stopped by their error on "
    "val over the whole 10 s, so errors on val are lower than on a new recording.",
    "by recording: a third of the recordings of train and val is held out as a whole; these recordings also decide "
    "when the training of networks stops. "
    "Standard errors and intervals are over recordings.",
    "test: if the authors' file of test trajectories is there, it is scored; it is never used to fit, stop or choose.",
)


def truck_report(one: Found) -> Document:
    """What was measured, beside what was published."""
    split = "test" if any(item["split"] == "test" for item in one["rows"]) else "val"
    notes: list[Part] = []
    if one["quick"]:
        notes.append(Text("Only the smallest networks were trained, with windows of 1 s and from one seed.", "Quick:"))
    if one["left_out"]:
        notes.append(
            Text(f"{one['left_out']} trainings were left out, since time ran out; tables show the others.", "Left out:")
        )
    rows = one["rows"]
    published = [row for row in rows if not row["by_recording"]]
    parts: tuple[Part, ...] = (
        *titled("Protocols", Points(PROTOCOLS), *notes),
        *titled("Grey boxes", _models([item for item in published if item["table"] in ("II", "grey box")]), Text(
            "RMSE of free runs of 10 s from the first reading, mean over trajectories, with standard errors. All "
            "models have the inputs v_x and alpha1. Models with both angles also have alpha2; the model with a map "
            "of the road's bank also has alpha2 and the position. From the fourth model on, inputs pass through "
            "filters that are not causal. Rows of Table II show the bicycle as its authors coded it, which differs "
            "from the printed one; they are means over the fifteen particles of least distance.")),
        *titled("Published figures, on the authors' test split", _paper(one["paper"])),
        *titled("Table III: networks, as published", _models([item for item in published if item["table"] == "III"])),
        *titled("Further networks", _models([item for item in published if item["table"] == "own"])),
        *titled("By recording", _models([row for row in rows if row["by_recording"]])),
        *titled("Table IV: gain over the MLP", _gains(published, split), Text(
            f"Gains on {split} of the best network of each method in each column; a gain above zero is better. The "
            "best network is chosen on the scored data, so all gains are overestimated by about the same amount.")),
        *titled("Paired, against the MLP of that size", _pairs(one["comparisons"], False), Text(PAIRED)),
        *titled(f"Paired, against the {BICYCLES[1]}", _pairs(one["comparisons"], True), Text(PAIRED)),
        *titled("Which effects of transfer learning are significant", _lessons(one["lessons"]), Text(
            "Networks of 4 x 8, windows of 1 s, on val: what each learned before it saw a recording.")),
        *titled("Beyond the speeds of the training", _beyond(one["out_of_range"]), Text(OUT_OF_RANGE)),
        *titled("Figures", *drawings(one)),
    )  # fmt: skip
    about = "Tables II to IV and Figs. 3 and 4 of the paper on transfer learning in lateral dynamics"
    return Document("A truck, ten seconds of free run", about, "a bench", f"greybox-id {__version__}", parts)


def drawings(result: Found) -> tuple[Drawing, ...]:
    """Figures of what there is, in the paper's order."""
    made = []
    published = [item for item in result["durations"] if not item["by_recording"]]
    drawn = _best_of_methods(published) + [item for item in published if item["model"] in BICYCLES[1:]]
    bicycles = [item for item in published if item["model"] in BICYCLES]
    if len(drawn) > 1:
        made.append(Drawing(
            "fig_3", over_durations(drawn),
            f"As Fig. 3 of the paper, on {drawn[0]['split']}. Errors of all trajectories over the time since their "
            "start, for the network of each method that is best over the whole 10 s. The bicycle with signs as "
            "published "
            f"has an error of {_end(bicycles, BICYCLES[0])} after 10 s and is not drawn.",
            "Errors of free runs over the time since their start.",
        ))  # fmt: skip
    traces = result["traces"]
    if traces:
        held = "; ".join(
            f"{item['model']} {100 * item['coverage'][0]:.1f} % of v_y, {100 * item['coverage'][1]:.1f} % of yaw rate"
            for item in traces["lines"]
        )
        made.append(Drawing(
            "fig_4", slalom(traces),
            f"As Fig. 4, a slalom of {traces['split']} (trajectory {traces['trajectory'] + 1}). The 95 % bands "
            f"combine two spreads: that of the errors on train at the same time after the start of a trajectory, and "
            f"that of the predictions of networks trained from different seeds. Share of all readings of "
            f"{traces['split']} inside: {held}.",
            "Measured and predicted lateral velocity and yaw rate over time.",
        ))  # fmt: skip
    if len({item["share"] for item in result["learning_curves"]}) > 1:
        seeds = min(item["seeds"] for item in result["learning_curves"])
        made.append(Drawing(
            "learning_curves", learning_curves(result["learning_curves"]),
            "Errors on val over the share of the training recordings, for networks of 4 x 8 with windows of 1 s: "
            "without pretraining, and pretrained on a bicycle that is fitted to the same share. Below, their ratio "
            "with 95 % "
            f"intervals over recordings. Seeds: {seeds}.",
            "Errors over the share of training data, and their ratio.",
        ))  # fmt: skip
    return tuple(made)


def _best_of_methods(durations: Sequence[Found]) -> list[Found]:
    """Of each method the network with the least v_y error over the whole time."""
    result = []
    for words in WORDS.values():
        value = [each for each in durations if each["model"].startswith(f"{words}, 4 x")]
        result += [min(value, key=lambda each: each["v_y"][-1])] if value else []
    return result


def _end(durations: Sequence[Found], model: str) -> str:
    value = next(each for each in durations if each["model"] == model)
    return f"{number(value['v_y'][-1], 2)} m/s and {number(value['yaw_rate'][-1], 2)} rad/s"


def _models(rows: Sequence[Found]) -> Table:
    body = tuple(
        (row["model"], str(row["parameters"]), row["split"],
         with_sd(row['v_y'], row['v_y_stderr']), with_sd(row['yaw_rate'], row['yaw_rate_stderr']),
         f"{row['cpu_seconds']:.1f}")
        for row in rows
    )  # fmt: skip
    return Table(("model", "numbers", "on", "v_y, m/s", "yaw rate, rad/s", "CPU s"), body, "lrlrrr")


def _paper(paper: Found) -> Table:
    body = tuple((name, f"{v_y:.4f}", f"{yaw_rate:.5f}") for name, (v_y, yaw_rate) in paper.items())
    return Table(("model", "v_y, m/s", "yaw rate, rad/s"), body, "lrr")


def _gains(rows: Sequence[Found], split: str) -> Table:
    """Percent by which the best of each method is better than the best MLP."""
    best: dict[str, dict[str, float]] = {}
    for words in WORDS.values():
        value = [
            r for r in rows if r["table"] == "III" and r["split"] == split and r["model"].startswith(f"{words}, 4 x")
        ]
        if value:
            best[words] = {output: min(r[output] for r in value) for output in UNITS}
    base = best.pop(WORDS["learning"], None)
    if base is None:
        return Table(("model",), ())
    body = tuple(
        (name, *(f"{100 * (1 - item[output] / base[output]):+.1f}".replace("-", "−") for output in UNITS))
        for name, item in best.items()
    )
    return Table(("model", "v_y, %", "yaw rate, %"), body, "lrr")


def _pairs(rows: Sequence[Found], beside_bicycle: bool) -> Table:
    body = tuple(
        (row["model"], f"{row['split']}{', by recording' if row['by_recording'] else ''}", *_difference(row))
        for row in rows if (row["against"] == BICYCLES[1]) == beside_bicycle
    )  # fmt: skip
    return Table(("model", "on", "output", "difference", "95 % interval", ""), body, "lllrrl")


def _lessons(rows: Sequence[Found]) -> Table:
    body = tuple(
        (f"{100 * row['share']:g} %", row["taught"], row["against"], *_difference(row)) for row in rows
    )  # fmt: skip
    return Table(("of train", "taught", "against", "output", "difference", "95 % interval", ""), body, "rlllrrl")


def _beyond(rows: Sequence[Found]) -> Table:
    body = tuple(
        (row["model"], row["output"].replace("_", " ").replace("v y", "v_y"), f"{row['error']:.4f}",
         f"{row['ratio']:.2f}", f"[{row['low']:.2f}, {row['high']:.2f}]", str(row["seeds"]))
        for row in rows
    )  # fmt: skip
    return Table(("model", "output", "RMSE, SI", "over MLP", "95 % interval", "seeds"), body, "llrrrr")


def _difference(value: Found) -> tuple[str, str, str, str]:
    better = "worse" if value["difference"] > 0 else "better"
    return (
        f"{value['output'].replace('_', ' ')} [{UNITS[value['output']]}]".replace("v y", "v_y"),
        f"{value['difference']:+.5f}".replace("-", "−"),
        f"[{value['low']:+.5f}, {value['high']:+.5f}]".replace("-", "−"),
        better if value["distinguished"] else "not distinguished",
    )
