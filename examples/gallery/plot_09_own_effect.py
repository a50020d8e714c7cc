"""
An effect of your own
=====================

A steering that gives way the faster one drives: a name, a magnitude, and what it alters. Any model that has the
signal can be given it.
"""

import matplotlib.pyplot as plt

import greybox_id as gb
from greybox_id.models.effects.stating import speed

soft_steering = gb.effects.alteration(
    "steering",
    "soft_steering",
    "s^2/m^2",
    0.0,
    (-0.05, 0.2),
    "share of the steering angle lost per squared speed",
    typical=0.01,
    steer=lambda steer, q: steer / (1 + q.p.soft_steering * speed(q) ** 2),
)

# %%
lap, other = (gb.read(gb.datasets.shipped(name), columns="roboracer") for name in ("racer_train", "racer_valid"))
rigid = gb.models.kinematic(understeer=False, vehicle="roboracer")
errors = {}
for name, model in {"rigid": rigid, "soft": rigid + soft_steering.free()}.items():
    fit = gb.fit(model, lap, validation=other)
    errors[name] = fit.metrics["validate"]["free run"]["yaw_rate"]["rmse"]
print(f"soft_steering {fit.params['soft_steering']:.4f} ± {fit.stderr['soft_steering']:.4f} s²/m²")

# %%
# Its magnitude is uncertain: other errors of so simple a model look alike, and its interval counts them. The error on
# the recording that neither fit has seen:
figure, axis = plt.subplots(figsize=(5, 2.5), layout="constrained")
axis.barh(list(errors), list(errors.values()))
axis.set_xlabel("RMSE of the yaw rate in free run [rad/s]")
