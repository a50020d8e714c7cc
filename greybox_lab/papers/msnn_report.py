"""The tables and figures of the paper on model-structured networks, measured anew, as a document."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from greybox_id.base.numbers import number, pretty_unit, with_sd
from greybox_id.base.version import __version__
from greybox_id.datasets.recording import Recording
from greybox_id.engine.simulation import Prediction
from greybox_id.fitting.adaptation.verb import parted
from greybox_id.fitting.scores.timing import CALIBRATED, calibration_words, timed
from greybox_id.models.memory_model import MemoryModel
from greybox_id.models.model import must_be
from greybox_id.reports.document import Document, Drawing, Part, Points, Table, Text, titled
from greybox_id.reports.recordings import noise

from .msnn import OURS, PHYSICAL, MsnnBench, Row, one_output
from .msnn_figures import adapted, criterion, densities, handling, predicted, responses, speed_ranges

UNITS = {"yaw_rate": "rad/s", "a_x": "m/s²"}
WORDS = {"yaw_rate": "yaw rate", "a_x": "a_x"}
PROTOCOLS = (
    "published: windows are laid across joins, and the RMSE is the mean of that of batches of 100 windows. FVU is "
    "computed as in the authors' validator. Prior strength and stopping are chosen on valid.csv, as by the authors. "
    "In Table 3, models are adapted to the whole recording of the changed car, and scored on it.",
    "honest: no window crosses a join, all samples are pooled, and standard errors are over blocks of one second. "
    "Nothing is chosen on scored data. In Table 3, models are adapted to the first 20 s of motion and scored on the "
    "rest.",
)
ADAM = (
    "CPU s are those of our fit, on one core. The authors train by Adam, some thousand epochs in batches of 100. The "
    "paper's "
    "recording with 10 % more mass is not public; single_mass is used instead, without a published figure."
)


def msnn_report(bench: MsnnBench) -> Document:
    """What was measured, beside what was published."""
    rows = bench.rows
    about = f"Tables 1 to 3 and Figs. 2 and 7 to 12 of Mungiello et al., on {bench.train.name} and {bench.valid.name}"
    words = (
        "This was a quick run: priors had their stated strength, and Fig. 7 has few structures. A full run "
        "cross-validates priors and fits all 288."
    )
    quick = (Text(words, "Quick:"),)
    parts: tuple[Part, ...] = (
        *titled("Protocols", Points(PROTOCOLS), Text(ADAM), *(quick if bench.quick else ())),
        *titled("Table 1: yaw rate, rad/s", _table([row for row in rows if row["table"] == 1])),
        *titled("Table 2: longitudinal acceleration, m/s²", _table([row for row in rows if row["table"] == 2])),
        *titled("Models compared", _comparisons(bench.comparisons), Text(
            f"RMSE minus that of {OURS}, on valid.csv, one sample ahead at the same rows; both models are trained on "
            "all of train.csv. 95 % intervals come from blocks drawn in pairs. A difference whose interval includes "
            "zero is not significant.")),
        *titled("Table 3: a changed car, yaw rate in rad/s, a_x in m/s²",
                _adapted_table([row for row in rows if row["table"] == 3]), Text(
            "RMSE of the original network → fine-tuned. CPU s are those of the slower of the two ways of tuning.")),
        *titled("Coupled networks: yaw rate in rad/s, a_x in m/s²",
                _coupled_table([row for row in rows if row["table"] == "coupled"]), Text(
            "Networks are trained on train.csv and scored on valid.csv; an ablation is that of the lateral or the "
            "longitudinal network. "
            f"Timing calibrated: errors one sample ahead, with {calibration_words(CALIBRATED)}; these seconds are "
            "not scored.")),
        *titled("Physical parameters", _physical(bench), Text(
            "The authors' figures come from their stored networks, which have a wheel of negative radius and "
            "inertia, a negative factor D on inertia, drag that drives, and a gain close to its pole. The bounds and "
            "priors of our models exclude such values.")),
        *titled("Figures", *drawings(bench)),
    )  # fmt: skip
    return Document("Model-structured networks of a 1:10 car", about, "a bench", f"greybox-id {__version__}", parts)


def _table(rows: Sequence[Row]) -> Table:
    """Rows as published and honest next to each other."""
    body = [
        (model, str(first["parameters"]), f"{share} %", split, _paper(first), _cell(by.get("published"), fvu=True),
         _cell(by.get("honest")), f"{first['cpu_seconds']:.1f}")
        for (model, share, split, _), by, first in _grouped(rows)
    ]  # fmt: skip
    return Table(("model", "weights", "train", "on", "paper", "published", "honest", "CPU s"), tuple(body), "lrrlrrrr")


def _coupled_table(rows: Sequence[Row]) -> Table:
    """All are fitted to all of train.csv and scored on valid.csv."""
    protocols = [item for item in dict.fromkeys(row["protocol"] for row in rows) if item != "published"]
    body = [
        (model.removesuffix(", coupled"), str(first["parameters"]), WORDS[output], _paper(first),
         _cell(by.get("published"), fvu=True), *(_cell(by.get(protocol)) for protocol in protocols),
         f"{first['cpu_seconds']:.1f}")
        for (model, _, _, output), by, first in _grouped(rows)
    ]  # fmt: skip
    known = ("timing told" if protocol.startswith("timing") else protocol.replace("_", " ") for protocol in protocols)
    head = ("model", "weights", "output", "paper", "published", *known, "CPU s")
    return Table(head, tuple(body), "lrl" + "r" * (len(head) - 3))


def _grouped(rows: Sequence[Row]) -> Iterator[tuple[tuple[str, int, str, str], dict[str, Row], Row]]:
    """Model, share, split and output, the rows of all protocols by name, and the first of them."""
    grouped: dict[tuple[str, int, str, str], dict[str, Row]] = {}
    for row in rows:
        grouped.setdefault((row["model"], row["share"], row["split"], row["output"]), {})[row["protocol"]] = row
    for key, by in grouped.items():
        yield key, by, next(iter(by.values()))


def _adapted_table(rows: Sequence[Row]) -> Table:
    """A row for each model, car and output: errors as it was, then fine-tuned or adapted."""
    grouped: dict[tuple[str, str, str], dict[tuple[str, str], Row]] = {}
    for row in rows:
        car, _, what = row["split"].partition(", ")
        grouped.setdefault((car, row["model"], row["output"]), {})[row["protocol"], what] = row
    body = []
    for (car, model, output), by in grouped.items():
        before, tuned, zero, after = (
            by.get(item)
            for item in (("published", "zero-shot"), ("published", "fine-tuned in sample"),
                        ("honest", "zero-shot"), ("honest", "adapted to 20 s"))
        )  # fmt: skip
        cpu = max(item["cpu_seconds"] for item in by.values())
        theirs = [f"{item['paper']:.3f}" if item and item["paper"] is not None else "–" for item in (before, tuned)]
        body.append((
            car, model, WORDS[output], _pair(*theirs), _pair(_cell(before, fvu=True), _cell(tuned, fvu=True)),
            _pair(_cell(zero), _cell(after)), f"{cpu:.1f}",
        ))  # fmt: skip
    head = ("car", "model", "output", "paper", "published, in sample", "honest, 20 s", "CPU s")
    return Table(head, tuple(body), "lllrrrr")


def _pair(before: str, after: str) -> str:
    return "–" if before == after == "–" else f"{before} → {after}"


def _paper(row: Row) -> str:
    if row["paper"] is None:
        return "–"
    return f"{row['paper']:.3f}" + ("" if row["paper_fvu"] is None else f" ({row['paper_fvu']:.3f})")


def _cell(row: Row | None, *, fvu: bool = False) -> str:
    if row is None:
        return "–"
    if fvu:
        return f"{row['rmse']:.3f} ({row['fvu']:.3f})"
    return with_sd(row["rmse"], row["stderr"])


def _comparisons(rows: Sequence[Row]) -> Table:
    body = tuple(
        (row["model"], f"{WORDS[row['output']]} [{UNITS[row['output']]}]",
         f"{row['difference']:+.4f}".replace("-", "−"),
         f"[{row['low']:+.4f}, {row['high']:+.4f}]".replace("-", "−"),
         ("worse" if row["difference"] > 0 else "better") if row["distinguished"] else "not distinguished")
        for row in rows
    )  # fmt: skip
    return Table(("model", "output", "difference of RMSE", "95 % interval", ""), body, "llrrl")


def _physical(msnn_bench: MsnnBench) -> Table:
    """Parameters with a physical meaning, and what follows from them, beside those of the authors' stored networks."""
    body: list[tuple[str, ...]] = []

    def told(name: str, what: str, value: float, theirs: float | None) -> None:
        body.append((name, what, number(value, 3), "–" if theirs is None else number(theirs, 3)))

    for (name, kind), theirs in PHYSICAL.items():
        model = msnn_bench.fits[name, kind].model
        for symbol, their in theirs.items():
            unit = model[symbol].unit
            told(name, symbol if unit == "1" else f"{symbol} [{pretty_unit(unit)}]", float(model[symbol].array), their)
    long, bench = msnn_bench.fits[OURS, "msnn_long"].model, msnn_bench.fits["MS-NN-bench", "msnn_bench_lat"].model
    m, I_w, r, A = (float(item.array) for item in (long["m"], long["I_w"], long["r"], bench["A"]))
    told(OURS, "D = 1 + 4 I_w/(m r²)", 1.0 + 4.0 * I_w / (m * r**2), -2.15)
    fastest = float(np.nanmax(msnn_bench.train["v_x"]))
    told("MS-NN-bench", f"1 + A v² at top speed, {fastest:.2f} m/s", *(1.0 + one * fastest**2 for one in (A, -0.070)))
    return Table(("model", "parameter", "ours", "the authors'"), tuple(body), "llrr")


def drawings(bench: MsnnBench) -> tuple[Drawing, ...]:
    """The figures, in the paper's order."""
    lat, long = bench.fits[OURS, "msnn_lat"], bench.fits[OURS, "msnn_long"]
    made = [
        Drawing("fig_2", speed_ranges(bench.train, lat),
                "As Fig. 2 of the paper. Curvature of the path over the steering angle in train.csv: the density of "
                "samples at all speeds, and a least-squares line for each third of the samples by speed. On the right: "
                "memberships of MS-NN-lat's local models over the steering angle.",
                "Curvature over steering angle with three lines; triangular memberships."),
        Drawing("fig_7", criterion(bench.grids), _criterion_words(bench), "AIC over the number of parameters."),
    ]  # fmt: skip
    recordings = {"train.csv": bench.train, "valid.csv": bench.valid}
    for output, name, words in (("yaw_rate", "fig_8", "8"), ("a_x", "fig_10", "10a to 10c")):
        seen = {where: _predictions(bench, recording, output) for where, recording in recordings.items()}
        made.append(Drawing(
            name, predicted(seen, recordings, output),
            f"As Fig. {words}. Errors one sample ahead: boxes hold the middle half of the samples, whiskers the middle "
            "95 %, bars are medians. Below, the 8 s of each recording in which the signal varies most.",
            f"Box plots of errors of the {WORDS[output]}, and predictions over time.",
        ))  # fmt: skip
        if output == "yaw_rate":
            made.append(Drawing(
                "fig_9", responses(lat),
                "As Fig. 9. Impulse responses of MS-NN-lat's local models over the age of a sample, with bands of one "
                "standard deviation; titles give the centre of a local model, in m/s and m/s².",
                "Impulse responses of local models.",
            ))  # fmt: skip
        else:
            heard = noise([bench.train, bench.valid])
            made.append(Drawing(
                "fig_10d", densities({n: item for n, item in seen["valid.csv"].items() if n != "MS-NN-bench"},
                                     bench.valid, output, heard),
                "As Fig. 10d. Power spectral densities on valid.csv: Welch's method within runs, Hamming windows that "
                "overlap by half.",
                "Power spectra of the measured acceleration and of residuals.",
            ))  # fmt: skip
    cars = {"nominal": bench.train, **bench.cars}
    made.append(Drawing(
        "fig_11", handling(cars),
        "As Fig. 11b. Handling diagram as measured: steering angle minus wheelbase (0.325 m) times curvature, over "
        "lateral acceleration, from samples at which yaw rate and speed hardly change. Curves are cubic fits with 95 "
        "% bands. The recordings are laps, not the paper's "
        "sinusoidal steering.",
        "Handling diagrams of several cars.",
    ))  # fmt: skip
    for car, recording in bench.cars.items():
        rest = parted(recording, 20.0)[1]
        if rest is None:
            continue
        seen_on = [
            (output, one_output(fit.model, rest, output), _after(bench, car, kind, rest, output))
            for output, kind, fit in (("yaw_rate", "msnn_lat", lat), ("a_x", "msnn_long", long))
        ]
        made.append(Drawing(
            f"fig_12_{car}", adapted(rest, seen_on),
            f"As Fig. 12, {car}. Predictions one sample ahead, by the original network and by the one adapted to the "
            "first 20 s of motion. Shown are the 8 s of the rest in which each signal varies most. "
            + " ".join(f"{kind}: {bench.adapted[car, kind].chosen.name}." for kind in ("msnn_lat", "msnn_long")),
            "Predictions before and after adaptation.",
        ))  # fmt: skip
    return tuple(made)


def _criterion_words(msnn_bench: MsnnBench) -> str:
    stated = []
    for name, grid in msnn_bench.grids.items():
        best, chosen = grid.aic_best, grid.chosen
        value, chose = (", ".join(f"{n} = {row[n]:g}" for n in grid.names) for row in (best, chosen))
        stated.append(
            f"{name}: {len(grid.table)} structures; least AIC {number(best['aic'], 4)} at {best['parameters']:g} "
            f"parameters ({value}); cross-validation on the training data chooses {chosen['parameters']:g} ({chose})."
        )
    return "As Fig. 7. Akaike's criterion as published, on valid.csv, over the number of parameters. " + " ".join(
        stated
    )


def _predictions(msnn_bench: MsnnBench, recording: Recording, output: str) -> dict[str, Prediction]:
    """Model -> predictions of an output, of the models of Figs. 8 and 10."""
    return {
        name: one_output(fit.model, recording, output)
        for name in (OURS, "G-NN", "MS-NN-bench")
        for (item, _), fit in msnn_bench.fits.items()
        if item == name and output in fit.model.outputs
    }


def _after(msnn_bench: MsnnBench, car: str, kind: str, rest: Recording, output: str) -> Prediction:
    """Predictions of the adapted network; of the run that goes on, with the delay that the new seconds told."""
    value = msnn_bench.adapted[car, kind]
    model = must_be(MemoryModel, value.fit.model)
    delays = {0: list(value.delays.values())[-1][output]} if value.delays else {}
    return timed(model, rest, delays)
