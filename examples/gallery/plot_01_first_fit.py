"""
A first fit
===========

Read a recording, fit a single track, and look at the verdict before the numbers.
"""

import greybox_id as gb

lap, other = (gb.read(gb.datasets.shipped(name), columns="roboracer") for name in ("racer_train", "racer_valid"))

# %%
# ``lateral`` is a single track at the measured speed. The vehicle file states the parameters of such a car, each with
# its uncertainty. Effects are added to a model: here the servo's dead time and its lag.
model = (
    gb.models.lateral(vehicle="roboracer") + gb.effects.steering_delay.free(start=0.03) + gb.effects.steering_lag.free()
)
fit = gb.fit(model, lap, validation=other)
print(fit.summary())

# %%
# *Usable with care*: the model predicts a held-out drive, but lacks an effect, and many estimates come from the
# vehicle file rather than from this drive. The page "A gap with four causes" shows how a missing effect is found.

# %%
# The 95 % interval of each parameter.
fit.conf_int(0.95)

# %%
# The free run of the fitted model on the recording that was not used in the fit: no reading corrects the simulation.
fit.plot.measured_and_simulated(other)
