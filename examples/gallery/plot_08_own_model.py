"""
A model of your own: a pendulum
===============================

The engine contains nothing about vehicles: equations, names and units are enough for a fit with intervals.
"""

import casadi as cs
import numpy as np

import greybox_id as gb


def dynamics(x, u, p, q):
    """A pendulum with friction, driven by a torque."""
    return {"angle": x.rate, "rate": (u.torque - p.friction * x.rate) / p.inertia - 9.81 / p.length * cs.sin(x.angle)}


pendulum = gb.models.MotionModel(
    name="pendulum",
    about="a pendulum with viscous friction, driven by a torque",
    states=(gb.models.State("angle", "rad"), gb.models.State("rate", "rad/s")),
    inputs=("torque",),
    outputs=("angle",),
    parameters=(
        gb.models.Parameter("length", "m", 0.5, (0.1, 2.0), about="distance of the mass from the pivot"),
        gb.models.Parameter("inertia", "kg m^2", 0.3, (0.01, 2.0), about="inertia about the pivot"),
        gb.models.Parameter("friction", "N m s/rad", 0.1, (0.0, 2.0), about="viscous friction of the bearing"),
    ),
    units={"torque": "N m"},
    dynamics=dynamics,
)

# %%
# A recording of a pendulum of 0.8 m, 0.5 kg m² and 0.05 N m s/rad, whose encoder has noise of 5 mrad.
time = np.arange(0.0, 20.0, 0.02)
torque = np.sign(np.sin(1.3 * time)) * np.sin(0.4 * time)
given = gb.Recording("swing", time, {"torque": torque}, extra_units={"torque": "N m"})
truth = [0.8, 0.5, 0.05]
swing = gb.simulate(pendulum.with_values(np.array(truth)), given)
measured = swing.signals["angle"] + np.random.default_rng(0).normal(0, 5e-3, len(time))
recording = gb.Recording(
    "swing", time, {"torque": torque, "angle": measured}, extra_units={"torque": "N m", "angle": "rad"}
)

# %%
fit = gb.fit(pendulum, recording)
print(fit.conf_int().assign(truth=truth))

# %%
fit.plot.measured_and_simulated(recording)
