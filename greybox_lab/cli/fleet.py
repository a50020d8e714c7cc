"""`greybox fleet`: thousands of recordings of many vehicles, and what they say together."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from greybox_id.cli.commands import CommandGroup
from greybox_id.cli.options import json_option
from greybox_id.cli.output import console, print_json, tell_result
from greybox_id.cli.terminal import tell
from greybox_id.reports.text.screen import Screen

if TYPE_CHECKING:
    from ..fleet.status import FleetProgress, Watch

EVERY = 10.0
"""s between plain lines of progress."""

results_argument = click.argument("results", metavar="RESULTS", type=click.Path(path_type=Path))


@click.group(name="fleet", cls=CommandGroup)
def fleet() -> None:
    """Check, fit and diagnose the recordings of many vehicles, and summarise them.

    \b
    greybox fleet run fleet.toml --out results --jobs 2
    greybox fleet status results
    greybox fleet estimate results
    greybox fleet report results --out fleet.html
    """


@fleet.command("run")
@click.argument("plan", metavar="FLEET.toml", type=click.Path(path_type=Path))
@click.option("--out", required=True, metavar="FOLDER", type=click.Path(path_type=Path), help="Folder of the results.")
@click.option(
    "--engine",
    type=click.Choice(["local", "dask"]),
    default="local",
    show_default=True,
    help="local: processes of this machine; dask: workers of Dask.",
)
@click.option("--scheduler", metavar="ADDRESS", help="With dask: address of the scheduler, as in tcp://host:8786.")
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Number of parallel recordings on this machine.",
)
@click.option(
    "--only",
    type=click.Choice(["all", "changed"]),
    default="all",
    show_default=True,
    help="'changed' skips files whose size and date are unchanged, without reading them.",
)
@click.option("--retry-failed", is_flag=True, help="Process again the recordings that failed or reached a limit.")
@click.option(
    "--compact", is_flag=True, help="Write each table as one file, without results of recordings that have changed."
)
@click.option(
    "--second-pass",
    "refit",
    is_flag=True,
    help="After the first pass, fit poorly excited recordings again, with the fleet's distribution as prior.",
)
@json_option
def run_command(
    plan: Path,
    out: Path,
    engine: Literal["local", "dask"],
    scheduler: str | None,
    jobs: int,
    only: Literal["all", "changed"],
    retry_failed: bool,
    compact: bool,
    refit: bool,
    as_json: bool,
) -> None:
    """Process every recording of FLEET.toml that is not done. After an interruption the same command continues.

    \b
    greybox fleet run fleet.toml --out results --jobs 2
    greybox fleet run fleet.toml --out results --engine dask --scheduler tcp://head:8786
    """  # fmt: skip
    from greybox_id.base.guard import claim

    from ..fleet.run import run

    claim(out)
    with _watching() as watch:
        result = run(
            plan, out, engine=engine, scheduler=scheduler, jobs=jobs, only=only, retry_failed=retry_failed,
            compact=compact, refit=refit, progress=watch,
        )  # fmt: skip
    tell_result(result, as_json)


@fleet.command("status")
@results_argument
@json_option
def status_command(results: Path, as_json: bool) -> None:
    """Report how many recordings of a fleet are processed, and with which results.

    \b
    greybox fleet status results
    """
    from ..fleet.status import status

    tell_result(status(results), as_json)


@fleet.command("estimate")
@results_argument
@json_option
def estimate_command(results: Path, as_json: bool) -> None:
    """Estimate population, vehicles and drift from RESULTS; no recording is read.

    \b
    greybox fleet estimate results
    """
    from ..fleet.estimate import estimate

    tell_result(estimate(results), as_json)


@fleet.command("report")
@results_argument
@click.option(
    "--out", metavar="FILE", type=click.Path(path_type=Path), help="Report to write; default: RESULTS/report.html."
)
@click.option(
    "--format", "kind", type=click.Choice(["html"]), default="html", show_default=True, help="Format of the report."
)
@click.option("--vehicle", metavar="NAME", help="Report on this vehicle alone.")
@json_option
def report_command(results: Path, out: Path | None, kind: str, vehicle: str | None, as_json: bool) -> None:
    """Write a report of RESULTS as one HTML page: the population; which vehicles deviate from it, since when and in
    which parameter; which recordings failed.

    \b
    greybox fleet report results --out fleet.html
    """  # fmt: skip
    from ..fleet.report import report

    del kind  # there is one
    written = report(results, out, vehicle=vehicle)
    if as_json:
        print_json({"written": str(written)})
    else:
        console().print(f"written  {written}")


@contextmanager
def _watching() -> Iterator[Watch]:
    """A live table on a terminal, plain lines elsewhere; both on standard error."""
    screen = Screen(errors=True, soft_wrap=True)
    shown = _Dashboard()
    if not screen.is_terminal:
        yield shown.plain
        shown.end()
        return
    from rich.live import Live

    from ..fleet.status import live

    with Live(console=screen, refresh_per_second=4, transient=True) as table:

        def drawn(progress: FleetProgress) -> None:
            shown.address(progress)
            table.update(live(progress))

        yield drawn


class _Dashboard:
    """Plain lines now and then; what is done again and why, the dashboard's address, what is waited for: each once."""

    def __init__(self) -> None:
        self._last, self._told, self._once = 0.0, "", set[str]()
        self._progress: FleetProgress | None = None

    def plain(self, progress: FleetProgress) -> None:
        self.address(progress)
        self._progress = progress
        if time.monotonic() - self._last > EVERY:
            self._last = time.monotonic()
            self._told = progress.line()
            tell(self._told)

    def address(self, progress: FleetProgress) -> None:
        for words in (progress.anew, f"dashboard {progress.dashboard}" if progress.dashboard else "", progress.lacks):
            if words and words not in self._once:
                self._once.add(words)
                tell(words)

    def end(self) -> None:
        if self._progress is not None and self._progress.line() != self._told:
            tell(self._progress.line())
