"""`greybox bench`: tables of published papers again, on their recordings."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from greybox_id.cli.commands import CommandGroup
from greybox_id.cli.options import JSON, PATH, command, option
from greybox_id.cli.output import console, print_json, progress, show

from ..driving.loop.protocol import ARMS as LEARNED_ARMS

if TYPE_CHECKING:  # imports that a call for help does not need
    from greybox_id.reports.document import Document

LOOP_ARMS = ("base", *LEARNED_ARMS, "oracle")
REPORT: Any = option("Write a report: to a folder (as HTML and PDF) or to a .md file (one page).", "PLACE")


def _data(required: bool = True) -> Any:
    return option("Folder of the recordings.", "FOLDER", type=PATH, required=required)


DATA: Any = _data()


@click.group(name="bench", cls=CommandGroup)
def bench() -> None:
    """Reproduce tables of published papers with the authors' recordings, and compare them with results of greybox-id.

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
        quick: bool = option("Compute with fewer random seeds, rows or targets; takes about a CPU minute."),
        report: str | None = REPORT,
        as_json: bool = JSON,
    ) -> None:
        from ..papers.bench import pages_of, write_pages

        pages = pages_of(report, name)
        with progress() as say:
            result = import_module(f"greybox_lab.papers.{module}").measure(data, quick, say)
            document = result.document()
            written = write_pages(document, pages, _command(name, data is not None, quick))
        _say(result.as_dict(), document, data, None, written, as_json)

    measured.__doc__ = f"{about}\n\n\b\ngreybox bench {name}{f' --data {folder}' if folder else ''} --quick"
    command(name, of=bench)(measured)


def _command(name: str, data: bool, quick: bool) -> str:
    """What makes a page again."""
    return f"greybox bench {name}{' --data DIR' if data else ''}{' --quick' if quick else ''}"


_on_others_ground(
    "a2rl", "a2rl", "a2rl",
    "Steering of a full-size racer: compare an inverse single track with a published network, and fit the actuator.",
)  # fmt: skip
_on_others_ground(
    "ferrari", "ferrari", "revs_telemetry",
    "Yaw of a Ferrari 250 LM: compare a single track with structured and black-box networks.",
)  # fmt: skip
_on_others_ground(
    "abs", "brakes", "abs",
    "Grip while braking: estimate it along a simulated lap on which it changes in steps.",
)  # fmt: skip
_on_others_ground(
    "emps",
    "emps",
    "",
    "A servo axis with friction (no car): compare fits of greybox-id and of other tools on the same rows.",
)


@command("msnn", of=bench)
def msnn_command(
    data: Path = DATA,
    quick: bool = option("Use preset strengths of the priors, without cross-validation; takes a few CPU minutes."),
    out: str | None = option("Write each result to this .json file as soon as it is known.", "FILE"),
    report: str | None = REPORT,
    as_json: bool = JSON,
) -> None:
    """Reproduce Tables 1 to 3 of the paper on model-structured networks of a 1:10 car.

    FOLDER must hold train.csv and valid.csv; it may hold tire_set_1.csv, tire_set_2.csv and single_mass.csv. The
    numbers of the paper are compared with two results: one as the authors computed it, and one in which nothing was
    chosen on the scored data. The report also has Figs. 2 and 7 to 12 of the paper.

    \b
    greybox bench msnn --data roboracer --quick --report msnn
    """  # fmt: skip
    from ..papers.bench import KeptBench, pages_of, write_pages
    from ..papers.msnn import measure
    from ..papers.msnn_report import msnn_report

    kept, pages = KeptBench("msnn", out), pages_of(report, "msnn")
    with progress() as say:
        result = measure(data, quick=quick, say=say, keep=lambda rows: kept.keep(quick=quick, rows=rows))
        kept.keep(quick=quick, rows=result.rows)
        document = msnn_report(result) if pages or not as_json else None
        written = [] if document is None else write_pages(document, pages, _command("msnn", True, quick))
    known = {"paper": "msnn", "quick": quick, "rows": result.rows, "comparisons": result.comparisons}
    _say(known, document, data, kept.file, written, as_json)


@command("truck", of=bench)
def truck_command(
    data: Path = DATA,
    quick: bool = option("Train only the smallest networks, from one seed; takes a few CPU minutes, not hours."),
    curves: bool = option(
        "Compute only how errors depend on the amount of training data, with and without pretraining."
    ),
    seeds: int = option("Number of trainings of each network.", type=click.IntRange(1, 100), default=5),
    out: str | None = option("File of finished trainings; the next run continues from them.", "FILE"),
    minutes: float | None = option(
        "Start no training after this many minutes; with --out the next run continues.", type=click.FloatRange(min=0)
    ),
    report: str | None = REPORT,
    as_json: bool = JSON,
) -> None:
    """Reproduce Tables II to IV of the transfer-learning paper: lateral dynamics of a truck in free runs of 10 s.

    FOLDER must hold train.parquet and val.parquet; it may hold test.parquet, which is scored and never fitted.
    The file of --out keeps every finished training; Ctrl-C loses only the current one.

    \b
    greybox bench truck --data truck --quick --json
    greybox bench truck --data truck --out truck.json --minutes 60 --report truck
    """  # fmt: skip
    from ..papers.bench import KeptBench, pages_of, write_pages
    from ..papers.truck import TruckOptions, truck_tables
    from ..papers.truck_report import truck_report

    kept, pages = KeptBench("truck", out, minutes), pages_of(report, "truck")
    with progress() as say:
        result = truck_tables(data, TruckOptions(quick, seeds, curves), say, kept)
        document = truck_report(result) if pages or not as_json else None
        written = [] if document is None else write_pages(document, pages, _command("truck", True, quick))
    _say(result, document, data, kept.file, written, as_json)


@command("loop", of=bench)
def loop_command(
    out: Path = option("Folder of the results.", "FOLDER", required=True, type=PATH),
    quick: bool = option(
        "Compare five ways to model one simulated car, in one cycle; takes about two CPU minutes, not hours."
    ),
    cases: tuple[int, ...] = option(
        "Simulated car of greybox loop demo, from 0 to 7; default: all of them. Repeatable.",
        name="--case",
        type=click.IntRange(0, 7),
        multiple=True,
    ),
    arms: tuple[str, ...] = option(
        "An arm, that is, a way to model the car for the training of a policy; default: all. Repeatable.",
        name="--arm",
        type=click.Choice(LOOP_ARMS),
        multiple=True,
    ),
    cycles: int | None = option(
        "Number of cycles of driving and training; in each, the policy may use more of the grip. "
        "Default: 3, with --quick 1.",
        type=click.IntRange(1, 3),
    ),
    vehicles: int = option("Number of vehicles drawn for each case.", type=click.IntRange(1, 20), default=1),
    seeds: int = option("Number of trainings with different seeds per vehicle.", type=click.IntRange(1, 20), default=1),
    as_json: bool = JSON,
) -> None:
    """Compare ways to correct the simulation in which a driving policy is trained: networks, or effects such as
    steering_delay.

    All policies drive the same cars, which differ from the vehicle file. Results are kept in FOLDER; the same command
    continues, and compares all results in it.

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
    document: Document | None,
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
    from greybox_id.reports.text.document import on_screen

    if document is not None:
        show(on_screen(document))
    for path in [*([] if file is None else [file]), *pages]:
        console().print(f"written  {path}")
