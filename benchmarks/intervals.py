"""Do 95 % intervals of profiles and of draws hold the truth where a model lacks an effect, as those of fits do?

    python benchmarks/intervals.py [--part lacking good] [--seed 0] [--fits 40] [--json]

Fits are those of `usable.py`, to virtual vehicles whose parameters are known: one effect is left out (lacking), or
nothing is (good). Intervals are the fit's, and those of profiles and of Laplace draws with the error of the model's
form and of the noise alone.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from running import options, tell
from threadpoolctl import threadpool_limits
from usable import Case, fit_of, good, lacking

import greybox_id as gb
from greybox_id.api.profiles import profiles
from greybox_id.base.errors import BadInput

PARTS: Mapping[str, Callable[[int, int], Case]] = {"lacking": lacking, "good": good}
DRAWS = 1000


def held(case: Case, seed: int) -> dict[str, list[tuple[bool, float]]]:
    """Kind of interval -> of every parameter, whether it holds the truth, and its width over that of the fit's."""
    fit = fit_of(case)
    known = [p.name for p in fit.model.parameters if p.name in case.truth and not p.fixed and p.shape == ()]
    names = [name for name in known if np.isfinite(float(fit.sd[name]))]
    found, table = (
        profiles(fit, names, [case.train]).found,
        gb.sample(fit, method="laplace", draws=DRAWS, seed=seed).table,
    )
    result: dict[str, list[tuple[bool, float]]] = {}
    for name in names:
        profile, row = found[name].profile, table.loc[name]
        low, high = map(float, fit.interval(name))
        ends = {
            "fit": (low, high), "profile": profile.interval, "profile, noise alone": profile.noise_alone.interval,
            "draws": (row["low"], row["high"]), "draws, noise alone": (row["low_noise_alone"], row["high_noise_alone"]),
        }  # fmt: skip
        for kind, (a, b) in ends.items():
            result.setdefault(kind, []).append((bool(a <= case.truth[name] <= b), float((b - a) / (high - low))))
    return result


def main() -> None:
    """Run the benchmark."""
    given = options(__doc__, part={"nargs": "+", "choices": PARTS, "default": list(PARTS)}, seed=0, fits=40)
    rows: list[dict[str, Any]] = []
    with threadpool_limits(1):
        for part in given.part:
            together: dict[str, list[tuple[bool, float]]] = {}
            for k in range(given.fits):
                try:
                    one = held(PARTS[part](given.seed, k), k)
                except BadInput as refusal:
                    sys.stderr.write(f"{part} {k}: {refusal}\n")
                    continue
                for kind, items in one.items():
                    together.setdefault(kind, []).extend(items)
            for kind, items in together.items():
                inside, widths = np.array(items).T
                rows.append(
                    {
                        "part": part, "interval": kind, "hold": int(np.sum(inside)), "of": len(items),
                        "share": float(np.mean(inside)), "median_width": float(np.median(widths)),
                    }
                )  # fmt: skip
    tell({"rows": rows}, given.json)


if __name__ == "__main__":
    main()
