"""
The next manoeuvre
==================

A fit shows which parameters are uncertain. A manoeuvre that is designed for a given arena
reduces this uncertainty.
"""

import matplotlib.pyplot as plt
import numpy as np

import greybox_id as gb

# %%
# A gentle drive of eight seconds: it contains little information on the yaw inertia and the friction of the tyres.
car = gb.models.single_track(vehicle="simrod")
time = np.arange(0.0, 8.0, 0.02)
commands = {"steer": 0.015 * np.sin(0.9 * time), "ax_cmd": 0.6 + 0.9 * np.sin(0.4 * time)}
start = gb.Recording("drive", time, {**commands, "v_x": np.full(len(time), 15.0)})
signals = gb.simulate(car, start).signals
random = np.random.default_rng(0)
noise = {"v_x": 0.05, "v_y": 0.1, "yaw_rate": 0.03, "a_x": 0.3, "a_y": 0.3}
drive = start.with_signals(**{name: signals[name] + random.normal(0, sd, len(time)) for name, sd in noise.items()})
fit = gb.fit("single_track", drive, vehicle="simrod")
fit.conf_int().loc[["I_z", "D_f"]]

# %%
# A manoeuvre of eight seconds on a road of 300 by 30 metres. The table states the standard deviations before and after
# it.
plan = gb.design(
    fit, "precision", arena="straight:300x30", parameters=["I_z", "D_f"], duration=8.0, rate=20.0, effort=0.2
)
print(plan.summary())

# %%
table = plan.table()
figure, axes = plt.subplots(2, 1, sharex=True, figsize=(7, 4), layout="constrained")
for axis, name, unit in zip(axes, ("steer", "v_x"), ("rad", "m/s"), strict=True):
    axis.plot(table["time"], table[name])
    axis.set_ylabel(f"{name} [{unit}]")
axes[-1].set_xlabel("time [s]")
