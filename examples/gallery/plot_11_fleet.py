"""
A fleet
=======

Two vehicles with three recordings each: the page estimates the parameters of each vehicle and of the fleet.
"""

from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import greybox_id as gb
from greybox_lab import fleet

folder = Path(mkdtemp())  # where this page writes

# %%
# Recordings in a folder for each vehicle. The second car's yaw inertia is larger by a fifth.
for vehicle, inertia in {"V0": 2274.0, "V1": 2729.0}.items():
    model = gb.models.lateral(tyre="linear", vehicle="full_size_car")
    model = model.with_parameters(replace(model["I_z"], value=inertia))
    for drive in range(3):
        time = np.arange(0.0, 8.0, 0.02)
        steer = 0.03 * np.sin((1.5 + 0.5 * drive) * time) + 0.01 * np.sign(np.sin(4.0 * time))
        lap = gb.Recording("lap", time, {"steer": steer, "v_x": np.full(len(time), 18.0)})
        table = lap.with_signals(**gb.simulate(model, lap).signals).to_pandas()
        noise = np.random.default_rng(drive).normal(0, [0.05, 0.01, 0.15], (len(time), 3))
        table[["v_y", "yaw_rate", "a_y"]] += noise
        file = folder / "data" / vehicle / f"drive{drive}.csv"
        file.parent.mkdir(parents=True, exist_ok=True)
        table.to_csv(file, index=False)

# %%
# A file states what is done with each recording. The command ``greybox fleet run fleet.toml --out results`` does the
# same as this call of ``fleet.run``.
(folder / "fleet.toml").write_text(
    """recordings = "data/{vehicle}/*.csv"
vehicle = "full_size_car"
steps = ["fit"]
[fit]
model = "lateral"
set = { tyre = "linear" }
solver = "gauss-newton"
horizon = 1.0
""",
    encoding="utf-8",
)
fleet.run(folder / "fleet.toml", folder / "results")
estimates = pd.read_parquet(folder / "results" / "parameters")
estimates.query("name == 'I_z'")[["vehicle", "value", "sd", "low", "high"]].round(0)

# %%
# The estimate of each vehicle, from all recordings of the fleet.
fleet.estimate(folder / "results")
vehicles = pd.read_parquet(folder / "results" / "vehicles").query("name == 'I_z'")
vehicles[["vehicle", "recordings", "value", "low", "high"]].round(0)

# %%
# The estimate from each single recording, and that of each vehicle from all its recordings, with 95 % intervals. Every
# single fit is pulled towards its priors, the numbers of the vehicle file; the estimates of the vehicles do not contain
# these priors.
fig, ax = plt.subplots(figsize=(6.4, 3.0), layout="constrained")
each = estimates.query("name == 'I_z'")
place = {"V0": 0.0, "V1": 1.0}
beside = each.groupby("vehicle").cumcount() * 0.1 + 0.1  # so that no bar covers another
for table, shift, size, colour, words in (
    (vehicles, 0.0, 2.5, "#0072b2", "from all its recordings"),
    (each, beside, 1.0, "#d55e00", "from one recording"),
):
    half = [table["value"] - table["low"], table["high"] - table["value"]]
    places = table["vehicle"].map(place) + shift
    ax.errorbar(places, table["value"], half, fmt="o", linewidth=size, color=colour, label=words)
ax.set(title="Yaw inertia of two vehicles", xlabel="vehicle", ylabel="yaw inertia [kg m²]", xlim=(-0.4, 1.7))
ax.set_xticks(list(place.values()), list(place))
ax.legend(loc="upper left")
