"""
An effect of your own
=====================

An effect is a name, a magnitude, and a rule for what it alters. Here, steering loses influence at higher speed. Such an
effect can be added to any model that has the altered signal.
"""

import matplotlib.pyplot as plt
import numpy as np

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
# A car with tyres is steered slowly at 6 to 26 m/s, so the recordings contain information on an effect that
# depends on speed.
car = gb.models.lateral(tyre="linear", vehicle="full_size_car")


def driven(name, rate, seed):
    """A minute of the car, its yaw rate read with noise of 5 mrad/s."""
    time = np.arange(0.0, 60.0, 0.02)
    v_x = 16.0 + 10.0 * np.sin(0.1 * time)
    commands = gb.Recording(name, time, {"steer": 0.6 / (v_x + 5.0) * np.sin(rate * time), "v_x": v_x})
    noise = np.random.default_rng(seed).normal(0.0, 0.005, len(time))
    return commands.with_signals(yaw_rate=gb.simulate(car, commands)["yaw_rate"] + noise)


lap, other = driven("lap", 0.5, 0), driven("other", 0.7, 1)

# %%
# The model contains only the geometry of the car. It is fitted once without and once with the effect.
rigid = gb.models.kinematic(understeer=False, vehicle="full_size_car")
fits = {
    name: gb.fit(model, lap, validation=other)
    for name, model in {"rigid": rigid, "soft": rigid + soft_steering.free()}.items()
}
print(fits["soft"].conf_int().loc["soft_steering"])

# %%
# The interval contains the true value, which is the understeer gradient that the car's tyres give:
p = {parameter.name: float(parameter.value) for parameter in car.parameters}
balance = p["l_r"] * p["C_alpha_r"] - p["l_f"] * p["C_alpha_f"]
print(f"{p['m'] * balance / ((p['l_f'] + p['l_r']) ** 2 * p['C_alpha_f'] * p['C_alpha_r']):.2e} s²/m²")

# %%
# On the recording that was used in neither fit, the effect reduces the error to the noise:
errors = {name: fit.metrics["validate"]["free run"]["yaw_rate"]["rmse"] for name, fit in fits.items()}
figure, axis = plt.subplots(figsize=(5, 2.5), layout="constrained")
axis.barh(list(errors), list(errors.values()), color="#0072b2")
axis.axvline(0.005, color="black", linestyle="dashed", label="noise")
axis.set(xlabel="RMSE of the yaw rate in free run [rad/s]", ylabel="model")
axis.legend()
