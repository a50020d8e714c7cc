"""
A first fit
===========

Read a recording, fit a single track, and look at the verdict before the numbers.
"""

import greybox_id as gb

lap, other = (gb.read(gb.datasets.shipped(name), columns="roboracer") for name in ("racer_train", "racer_valid"))

# %%
# ``lateral`` is a single track at the measured speed. The vehicle file has the numbers of such a car, each with
# its uncertainty. Effects are added to a model: here the servo's dead time and its lag.
model = (
    gb.models.lateral(vehicle="roboracer") + gb.effects.steering_delay.free(start=0.03) + gb.effects.steering_lag.free()
)
fit = gb.fit(model, lap, validation=other)
print(fit.summary())

# %%
# *Usable with care*: the model predicts a held-out drive, but lacks an effect, and many numbers come from the
# vehicle file rather than from this drive. The page on a gap looks for the effect.

# %%
# Estimates with 95 % intervals, by name.
fit.conf_int(0.95)

# %%
# The fit in free run on the recording that it has not seen: no reading corrects the simulation.
fit.plot.measured_and_simulated(other)
