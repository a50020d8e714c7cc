"""
Before and after
================

The same car on two days: a diagnosis names what changed by more than the scatter between drives of one day.
"""

import numpy as np

import greybox_id as gb

before = gb.models.lateral(vehicle="full_size_car")
after = before + gb.effects.steering_delay.at(0.08)


def driven(model, name, rate, seed):
    """Twenty seconds of driving, with sensors' noise."""
    time = np.arange(0.0, 20.0, 0.02)
    steer = 0.03 * np.sin(rate * time) + 0.01 * np.sign(np.sin(2.3 * rate * time))
    lap = gb.Recording(name, time, {"steer": steer, "v_x": 18.0 + 3.0 * np.sin(0.3 * time)})
    signals = gb.simulate(model, lap).signals
    random = np.random.default_rng(seed)
    noise = {"v_y": 0.05, "yaw_rate": 0.01, "a_y": 0.15}
    return lap.with_signals(**{key: signals[key] + random.normal(0, sd, len(time)) for key, sd in noise.items()})


monday = [driven(before, f"monday{k}", 0.9 + 0.2 * k, k) for k in range(3)]
friday = [driven(after, f"friday{k}", 1.0 + 0.2 * k, 10 + k) for k in range(2)]

# %%
# Three earlier drives give the scatter between drives; two later drives are examined for a change.
suspects = ["steering_delay", "steering_lag", "grip_scale", "mass_change"]
change = gb.diagnose("lateral", friday, since=monday, vehicle="full_size_car", effects=suspects)
print(change.summary())

# %%
change.plot()
