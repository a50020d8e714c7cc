"""Does closing the gap drive better?

    python examples/nmpc/race.py --out nmpc

A vehicle that exists in simulation only has two things the matter that its file does not state. A driver drives it for
a minute, `greybox gap` diagnoses the recording, and a model-predictive controller drives a lap near the limit of grip,
three times: believing the vehicle file, the closed vehicle, and the truth. See README.md.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from c_driver import CDriver
from controller import Controller
from figure import draw
from lap import Driver, Lap, lap
from prediction import Prediction
from rich.console import Console
from rich.table import Table
from scene import PAIRS, PERIOD, SEED, Scene

from greybox_id.base.files import write_atomically
from greybox_id.models.motion_model import MotionModel

WIDTH = 170
"""Of the table, characters."""


@dataclass(frozen=True)
class Race:
    """A scene, driven with each model.

    Attributes
    ----------
    scene : what was driven.
    found : effects of the closed model, by name.
    laps : model -> lap.
    """

    scene: Scene
    found: Mapping[str, float]
    laps: Mapping[str, Lap]

    def removed(self, error: str) -> float:
        """Share of the nominal model's excess path error that the closed model removes; "rms" or "p95"."""
        nominal, closed, true = (getattr(self.laps[name], error) for name in ("nominal", "closed", "true"))
        return float((nominal - closed) / (nominal - true))


def race(scene: Scene, folder: Path, language: str) -> Race:
    """Diagnose a scene, and drive it with a controller in "python" or "c"."""
    models = scene.models(folder)
    closed = models["closed"]
    found = {name: float(closed[name].array) for name in closed.effects}
    laps = {}
    for name, model in models.items():
        built = folder / "c" / name if language == "c" else None
        laps[name] = driven(scene, model, built)
    return Race(scene, found, laps)


def driven(scene: Scene, model: MotionModel, built: Path | None = None, until: float = float("inf")) -> Lap:
    """A lap, or a part of it, of a controller that believes a model; in C where there is a folder to build it in."""
    wishes, track = scene.wishes, scene.track
    v_x = float(track.speed[0])
    driver: Driver
    if built is None:
        driver = Controller(Prediction(model, PERIOD, wishes.units), track, wishes, v_x)
    else:
        driver = CDriver(model, PERIOD, track, wishes, v_x, built)
    return lap(scene.car, scene.effects, scene.forms, SEED, track, driver, PERIOD, until)


def main() -> None:
    """Race all pairs, print what came of it, and write it down."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("nmpc"), help="folder for race.json, figures and recordings")
    parser.add_argument("--forms", choices=("nominal", "other"), default="nominal", help="mathematical forms it has")
    parser.add_argument("--pairs", type=int, nargs="*", default=range(len(PAIRS)), help="numbers of pairs, from 0")
    parser.add_argument("--controller", choices=("python", "c"), default="python", help="which of the two")
    asked = parser.parse_args()
    races = []
    for k in asked.pairs:
        folder = asked.out / "_and_".join(PAIRS[k])
        races.append(race(Scene(PAIRS[k], asked.forms), folder, asked.controller))
        show(races[-1])
        draw(races[-1].scene.track, races[-1].laps, folder)
    text = json.dumps([as_data(one) for one in races], indent=1)
    print(f"\nwritten  {write_atomically(asked.out / 'race.json', text)}")


def show(one: Race) -> None:
    """Print a race."""
    console = Console(width=WIDTH)
    said = ", ".join(f"{name} {value:.4g}" for name, value in one.scene.effects.items())
    found = ", ".join(f"{name} {value:.4g}" for name, value in one.found.items())
    console.print(f"\n[bold]{said}[/bold]\nclosed by greybox gap with {found or 'nothing'}")
    table = Table()
    for column in ("model", "lap s", "path error rms mm", "95 % mm", "excess rms mm", "speed error rms m/s",
                   "beyond track, grip, steering %", "solve median, 95 %, max ms", "not solved"):  # fmt: skip
        table.add_column(column, justify="left" if column == "model" else "right")
    for row in rows(one):
        table.add_row(*row)
    console.print(table)
    rms, p95 = (one.removed(error) for error in ("rms", "p95"))
    console.print(f"The closed model removes {rms:.0%} of the excess path error (95 % quantile: {p95:.0%}).")


def rows(one: Race) -> Iterator[tuple[str, ...]]:
    """The table, a model at a time."""
    for name, own in one.laps.items():
        yield (
            name,
            f"{own.time:.2f}" if own.finished else f"lost after {own.s[-1]:.0f} m",
            f"{1e3 * own.rms:.1f}",
            f"{1e3 * own.p95:.1f}",
            f"{1e3 * (own.rms - one.laps['true'].rms):.1f}",
            f"{(own.speed_error**2).mean() ** 0.5:.3f}",
            ", ".join(f"{100 * share:.1f}" for share in (own.beyond_track, own.beyond_grip, own.beyond_steering)),
            ", ".join(f"{1e3 * seconds:.1f}" for seconds in own.solve),
            f"{own.failures} of {len(own.s)}",
        )


def as_data(one: Race) -> dict[str, Any]:
    """A race as plain data, SI units."""
    return {
        "effects": dict(one.scene.effects),
        "forms": one.scene.forms,
        "found": dict(one.found),
        "removed": {error: one.removed(error) for error in ("rms", "p95")},
        "laps": {
            name: {
                "time": own.time,
                "finished": own.finished,
                "path_error": {"rms": own.rms, "p95": own.p95, "max": float(abs(own.e_y).max())},
                "excess_rms": own.rms - one.laps["true"].rms,
                "speed_error_rms": float((own.speed_error**2).mean() ** 0.5),
                "beyond": {"track": own.beyond_track, "grip": own.beyond_grip, "steering": own.beyond_steering},
                "largest_use_of_grip": float(own.use.max()),
                "solve": dict(zip(("median", "p95", "max"), own.solve, strict=True)),
                "not_solved": own.failures,
            }
            for name, own in one.laps.items()
        },
    }


if __name__ == "__main__":
    main()
