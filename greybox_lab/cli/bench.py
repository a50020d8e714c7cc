"""`greybox bench`: tables of published papers again, on their recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from greybox_id.cli.commands import CommandGroup
from greybox_id.cli.options import JSON, PATH, command, option
from greybox_id.cli.output import console, print_json, progress, show

from ..driving.loop.protocol import ARMS as LEARNED_ARMS

LOOP_ARMS = ("base", *LEARNED_ARMS, "oracle")
REPORT: Any = option("Report to write: a folder, for HTML and PDF, or a FILE.md, for one page.", "PLACE")


def _data(required: bool = True) -> Any:
    return option("Folder of the recordings.", "FOLDER", type=PATH, required=required)


DATA: Any = _data()


@click.group(name="bench", cls=CommandGroup)
def bench() -> None:
    """Reproduce tables of published papers on the authors' recordings, and compare them with the results of greybox-id.

    \b
    greybox bench a2rl --data a2rl --quick
    greybox bench msnn --data roboracer --quick
    greybox bench loop --quick --out black_box
    """  # fmt: skip


def _on_others_ground(name: str, module: str, folder: str, about: str) -> None:
    """A command for a bench whose module has `measure`: rows beside published ones, one page."""
    recordings = _data(bool(folder))

    def measured(
        data: Path | None = recordings,
        quick: bool = option("Use fewer seeds, rows and targets; takes about a CPU minute."),
        report: str | None = REPORT,
        as_json: bool = JSON,
    ) -> None:
        from ..papers.bench import on_screen, pages_of, write_pages

        pages = pages_of(report, name)
        with progress() as say:
            result = import_module(f"greybox_lab.papers.{module}").measure(data, quick, say)
            document = result.document()
            written = write_pages(document, pages, _command(name, data is not None, quick))
        _say(result.as_dict(), on_screen(document), data, None, written, as_json)

    measured.__doc__ = f"{about}\n\n\b\ngreybox bench {name}{f' --data {folder}' if folder else ''} --quick"
    command(name, of=bench)(measured)


def _command(name: str, data: bool, quick: bool) -> str:
    """What makes a page again."""
    return f"greybox bench {name}{' --data DIR' if data else ''}{' --quick' if quick else ''}"


_on_others_ground(
    "a2rl", "a2rl", "a2rl",
    "Steering of a full-size racer: compare an inverse single track with a published network, and fit the servo.",
)  # fmt: skip
_on_others_ground(
    "ferrari", "ferrari", "revs_telemetry",
    "Yaw of a Ferrari 250 LM: compare a single track with structured and black-box networks.",
)  # fmt: skip
_on_others_ground(
    "abs", "brakes", "abs",
    "Grip while braking: estimate it along a lap on which it changes in steps; the recordings are from another "
    "simulator.",
)  # fmt: skip
_on_others_ground(
    "emps",
    "emps",
    "",
    "A servo axis with friction (no car): fit it with this package and other tools, on the same rows and in one run.",
)


@command("msnn", of=bench)
def msnn_command(
    data: Path = DATA,
    quick: bool = option(
        "Use the stated strengths of the priors instead of cross-validated strengths; takes some CPU minutes."
    ),
    out: str | None = option("A .json file, to which each result is also written as soon as it is known.", "FILE"),
    report: str | None = REPORT,
    as_json: bool = JSON,
) -> None:
    """Reproduce Tables 1 to 3 of the paper on model-structured networks of a 1:10 car.

    FOLDER holds train.csv and valid.csv, and perhaps tire_set_1.csv, tire_set_2.csv and single_mass.csv. Two protocols
    are compared with the paper's figures: exactly that of the authors, and one in which nothing is chosen on scored
    data. The report holds Figs. 2 and 7 to 12 too.

    \b
    greybox bench msnn --data roboracer --quick --report msnn
    """  # fmt: skip
    from ..papers.bench import KeptBench, on_screen, pages_of, write_pages
    from ..papers.msnn import measure
    from ..papers.msnn_report import msnn_report

    kept, pages = KeptBench("msnn", out), pages_of(report, "msnn")
    with progress() as say:
        result = measure(data, quick=quick, say=say, keep=lambda rows: kept.keep(quick=quick, rows=rows))
        kept.keep(quick=quick, rows=result.rows)
        document = msnn_report(result) if pages or not as_json else None
        written = [] if document is None else write_pages(document, pages, _command("msnn", True, quick))
    known = {"paper": "msnn", "quick": quick, "rows": result.rows, "comparisons": result.comparisons}
    _say(known, [] if document is None else on_screen(document), data, kept.file, written, as_json)


@command("truck", of=bench)
def truck_command(
    data: Path = DATA,
    quick: bool = option("Train only the smallest networks, from one seed: a few CPU minutes, not hours."),
    curves: bool = option("Make only the learning curves and the pretrained networks."),
    seeds: int = option("Number of trainings of each network.", type=click.IntRange(1, 100), default=5),
    out: str | None = option("File that keeps finished trainings; the next run continues from them.", "FILE"),
    minutes: float | None = option(
        "Start no training after this many minutes; with --out the next run continues.", type=click.FloatRange(min=0)
    ),
    report: str | None = REPORT,
    as_json: bool = JSON,
) -> None:
    """Tables II to IV of the transfer-learning paper: a truck's lateral dynamics over 10 s of free run.

    FOLDER holds train.parquet and val.parquet, and perhaps test.parquet, which is scored and never fitted.
    Every finished training is kept in --out; Ctrl-C loses only the current one.

    \b
    greybox bench truck --data truck --quick --json
    greybox bench truck --data truck --out truck.json --minutes 60 --report truck
    """  # fmt: skip
    from ..papers.bench import KeptBench, on_screen, pages_of, write_pages
    from ..papers.truck import TruckOptions, truck_tables
    from ..papers.truck_report import truck_report

    kept, pages = KeptBench("truck", out, minutes), pages_of(report, "truck")
    with progress() as say:
        result = truck_tables(data, TruckOptions(quick, seeds, curves), say, kept)
        document = truck_report(result) if pages or not as_json else None
        written = [] if document is None else write_pages(document, pages, _command("truck", True, quick))
    _say(result, [] if document is None else on_screen(document), data, kept.file, written, as_json)


@command("loop", of=bench)
def loop_command(
    out: Path = option("Folder of the results.", "FOLDER", required=True, type=PATH),
    quick: bool = option("Run one case, one cycle and five drivers (arms): about two CPU minutes, not hours."),
    cases: tuple[int, ...] = option(
        "Number of a case of greybox loop demo; default: all cases.",
        name="--case",
        type=click.IntRange(0, 7),
        multiple=True,
    ),
    arms: tuple[str, ...] = option(
        "A driver (arm) to compare; default: all of them.", name="--arm", type=click.Choice(LOOP_ARMS), multiple=True
    ),
    cycles: int | None = option(
        "Number of cycles of driving and learning; each allows a larger share of the grip. "
        "Default: 3, or 1 with --quick.",
        type=click.IntRange(1, 3),
    ),
    vehicles: int = option("Number of vehicles drawn for each case.", type=click.IntRange(1, 20), default=1),
    seeds: int = option("Number of random seeds of learning for each vehicle.", type=click.IntRange(1, 20), default=1),
    as_json: bool = JSON,
) -> None:
    """Compare black boxes with named effects: drivers that learn on networks, and drivers that learn on named effects,
    drive the same changed cars.

    Results are kept in FOLDER; the same command continues and compares all results in it.

    \b
    greybox bench loop --quick --out black_box
    greybox bench loop --out black_box --case 1 --case 6 --arm base --arm named --arm oracle --json
    """  # fmt: skip
    from ..papers.loop import loop_tables
    from ..papers.loop_report import tables

    with progress() as say:
        result = loop_tables(
            out, quick=quick, cases=cases, arms=arms, cycles=cycles, vehicles=vehicles, seeds=seeds, say=say
        )
    if as_json:
        print_json(result)
    else:
        show(tables(result))


def _say(
    known: Mapping[str, Any],
    parts: Iterable[Any],
    data: Path | None,
    file: Path | None,
    pages: list[Path],
    as_json: bool,
) -> None:
    """What was measured, on what, and where it was written."""
    if as_json:
        from ..papers.bench import hashes

        known = {**known, "data": hashes(data)}
        written = {"written": str(file)} if file else {}
        print_json({**known, **written} | ({"report": [str(page) for page in pages]} if pages else {}))
        return
    show(parts)
    for path in [*([] if file is None else [file]), *pages]:
        console().print(f"written  {path}")
