"""What a fleet says of a fit to come: of a vehicle without recordings, or of a recording that is fitted again."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from greybox_id.base.files import write_atomically
from greybox_id.base.shorthands import Array

from .drift import Drifted, drifted
from .hierarchy import marginal
from .joined import JoinedFits, doubted, joined_fits, natural
from .statuses import OK
from .store import Store

PRIOR = "prior.toml"


@dataclass(frozen=True)
class SecondPass:
    """What is fitted again, and with which priors.

    Attributes
    ----------
    keys : of recordings, whose own fit knows a parameter less well than the fleet does, lies apart or is not confirmed.
    priors : as `greybox fit --prior` takes them.
    """

    keys: frozenset[str]
    priors: tuple[str, ...]

    def beside(self, entry: Any) -> list[str]:
        """The priors of a plan that these do not replace."""
        texts = [f"{name}={value}" for name, value in entry.items()] if isinstance(entry, Mapping) else entry
        taken = {text.partition("=")[0].strip() for text in self.priors}
        several = [texts] if isinstance(texts, str) else texts
        return [text for text in several if text.partition("=")[0].strip() not in taken]


def second_pass(store: Store) -> SecondPass:
    """Which recordings gain by a second fit, with what first fits say of the fleet as prior."""
    recordings = store.current()
    joined, _ = joined_fits(store, recordings, refits=False)
    if joined is None:
        return SecondPass(frozenset(), ())
    result = drifted(joined.seen, joined.order, joined.x, doubted(store, joined))
    width = widths(joined, result)
    _, covariance = marginal(joined.seen)
    free = np.diagonal(joined.seen.information, axis1=1, axis2=2) > 0
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    poor = result.apart | np.any(free & (sd > width), axis=1)
    good = {key for key, item in zip(joined.keys, poor, strict=True) if not item}
    fitted = recordings[recordings["status"] == OK]["key"]
    texts = []
    for k, (name, unit, log) in enumerate(zip(joined.names, joined.units, joined.logs, strict=True)):
        mean = natural(float(result.population.mean[k]), log)
        texts.append(prior_text(name, mean, float(width[k]) * (mean if log else 1.0), unit))
    return SecondPass(frozenset(str(key) for key in fitted if key not in good), tuple(texts))


def widths(joined: JoinedFits, drifted: Drifted) -> Array:
    """Standard deviation of what a recording of a vehicle that is not known has, in the coordinates of estimates."""
    population = drifted.population
    spread = population.spread if len(joined.vehicles) > 1 else 0.0
    width: Array = np.sqrt(spread + population.scatter + np.diag(population.mean_covariance))
    return width


def prior_text(name: str, mean: float, width: float, unit: str) -> str:
    """A prior as `greybox fit --prior` takes it."""
    return f"{name}={mean:.6g}±{width:.3g} {'' if unit == '1' else unit}".rstrip()


def write_prior(
    folder: Path, rows: Sequence[Mapping[str, Any]], joined: JoinedFits | None, drifted: Drifted | None
) -> None:  # fmt: skip
    """What the next vehicle of the class is expected to have, as defaults of `greybox fit`."""
    lines = [
        "# Prior for a vehicle of this fleet that has no recordings yet, as defaults of a fit.",
        "[fit]",
        "prior = [",
    ]
    for k, row in enumerate(rows):
        if joined is not None and drifted is not None and math.isfinite(row["spread"]):
            width = float(widths(joined, drifted)[k]) * (row["mean"] if row["logarithm"] else 1.0)
            lines.append(f'    "{prior_text(row["name"], row["mean"], width, row["unit"])}",')
    write_atomically(folder / PRIOR, "\n".join([*lines, "]", ""]), continued=True)
