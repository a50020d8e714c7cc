"""
The next manoeuvre
==================

A fit says which parameters it knows badly. A designed manoeuvre says what to drive to know them better, inside the
arena there is.
"""

import matplotlib.pyplot as plt

import greybox_id as gb

lap = gb.read(gb.shipped("racer_train"), columns="roboracer").rows(0, 400)
fit = gb.fit("single_track", lap, vehicle="roboracer")
fit.conf_int()

# %%
# Six seconds in a disc of ten metres, for the yaw inertia and the friction coefficient of the front tyres.
plan = gb.design(fit, "precision", arena="disc:10", parameters=["I_z", "D_f"], duration=6.0, rate=20.0, effort=0.2)
print(plan.summary())

# %%
table = plan.table()
figure, axes = plt.subplots(2, 1, sharex=True, figsize=(7, 4), layout="constrained")
for axis, name, unit in zip(axes, ("steer", "v_x"), ("rad", "m/s"), strict=True):
    axis.plot(table["time"], table[name])
    axis.set_ylabel(f"{name} [{unit}]")
axes[-1].set_xlabel("time [s]")
