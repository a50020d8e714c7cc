"""The picture of the README: `python docs/picture.py` fits the shipped recording and draws docs/fit.png."""

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

from matplotlib.figure import Figure

import greybox_id as gb


def main() -> None:
    """Draw it."""
    lap, other = (gb.read(gb.datasets.shipped(name), columns="roboracer") for name in ("racer_train", "racer_valid"))
    model = gb.models.lateral(tyre="pacejka", vehicle="roboracer") + gb.effects.steering_delay.free(start=0.03)
    fit = gb.fit(model, lap, validation=other, options=gb.FitOptions(seed=0))
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    over_time, tyres = figure.subplots(1, 2, width_ratios=(3, 2))
    start, stop = max(other.runs, key=lambda run: run[1] - run[0])
    stretch = other.rows(start, min(stop, start + 300))
    over_time.plot(stretch.time, stretch["yaw_rate"], color="0.45", linewidth=1.0, label="measured")
    over_time.plot(stretch.time, fit.simulate(stretch)["yaw_rate"], linewidth=1.4, label="simulated")
    over_time.set(title="held-out recording, free run", xlabel="time [s]", ylabel="yaw rate [rad/s]")
    over_time.legend(loc="upper left")
    fit.plot.tyres(ax=tyres)
    tyres.set_title("tyres, with 95 % bands")
    figure.savefig(Path(__file__).with_name("fit.png"), dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
