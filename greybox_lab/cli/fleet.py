"""`greybox fleet`: thousands of recordings of many vehicles, and what they say together."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from greybox_id.cli.commands import CommandGroup
from greybox_id.cli.options import FROM_ONE, JSON, PATH, argument, command, option
from greybox_id.cli.output import console, print_json, tell_result
from greybox_id.cli.terminal import tell
from greybox_id.reports.text.screen import Screen

if TYPE_CHECKING:
    from ..fleet.status import FleetProgress, Watch

EVERY = 10.0
"""s between plain lines of progress."""

RESULTS: Any = argument("RESULTS", type=PATH)


@click.group(name="fleet", cls=CommandGroup)
def fleet() -> None:
    """Check, fit and diagnose the recordings of many vehicles, and compare the vehicles.

    \b
    greybox fleet run fleet.toml --out results --jobs 2
    greybox fleet status results
    greybox fleet estimate results
    greybox fleet report results --out fleet.html
    """


@command("run", of=fleet)
def run_command(
    plan: Path = argument("FLEET.toml", type=PATH),
    out: Path = option("Folder of the results.", "FOLDER", required=True, type=PATH),
    engine: Literal["local", "dask"] = option(
        "Where the work runs. local: in processes of this machine; dask: on workers of Dask.", default="local"
    ),
    scheduler: str | None = option("Address of the scheduler of Dask, as in tcp://host:8786.", "ADDRESS"),
    jobs: int = option(
        "Number of recordings that are processed in parallel on this machine.", type=FROM_ONE, default=1
    ),
    only: Literal["all", "changed"] = option(
        "all: read every file to see whether it has changed; changed: skip files whose size and date are the same.",
        default="all",
    ),
    retry_failed: bool = option("Also process recordings that failed or reached a limit before."),
    compact: bool = option("Rewrite each table of results as one file, and drop outdated rows."),
    refit: bool = option(
        "Fit recordings with little excitation a second time, with the distribution over the fleet as prior.",
        name="--second-pass",
    ),
    as_json: bool = JSON,
) -> None:
    """Process every recording of FLEET.toml that has not been processed yet.

    After an interruption the same command continues.

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


@command("status", of=fleet)
def status_command(
    results: Path = RESULTS,
    as_json: bool = JSON,
) -> None:
    """Print how many recordings of a fleet have been processed, and how many failed.

    \b
    greybox fleet status results
    """
    from ..fleet.status import status

    tell_result(status(results), as_json)


@command("estimate", of=fleet)
def estimate_command(
    results: Path = RESULTS,
    as_json: bool = JSON,
) -> None:
    """Estimate from RESULTS the mean of the fleet, the values of each vehicle, and changes over time.

    No recording is read.

    \b
    greybox fleet estimate results
    """
    from ..fleet.estimate import estimate

    tell_result(estimate(results), as_json)


@command("report", of=fleet)
def report_command(
    results: Path = RESULTS,
    out: Path | None = option("Report to write, a .html file; default: RESULTS/report.html.", "FILE", type=PATH),
    kind: str = option("Format of the report.", name="--format", type=click.Choice(["html"]), default="html"),
    vehicle: str | None = option("Report only on this vehicle.", "NAME"),
    as_json: bool = JSON,
) -> None:
    """Write a report of RESULTS as one HTML page.

    It shows the distribution over the fleet, which vehicles deviate from it, since when and in which parameter, and
    which recordings failed.

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
