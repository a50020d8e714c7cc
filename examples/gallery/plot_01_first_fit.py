"""
A first fit
===========

Read a recording, fit a single track, and look at the verdict before the numbers.
"""

import greybox_id as gb

lap, other = (gb.read(gb.datasets.shipped(name), columns="roboracer") for name in ("racer_train", "racer_valid"))
lap, other = lap.rows(0, 800), other.rows(0, 400)

# %%
# ``lateral`` is a single track at the measured speed. The vehicle file brings what is known of such a car beforehand,
# each number with its uncertainty. ``steering_delay`` is one of 47 effects that can be added to a model.
model = gb.models.lateral(vehicle="roboracer") + gb.effects.steering_delay.free(start=0.03)
fit = gb.fit(model, lap, validation=other)
print(fit.summary())

# %%
# Estimates with 95 % intervals, by name.
fit.conf_int(0.95)

# %%
# The fit in free run on the recording that it has not seen: no reading corrects the simulation.
fit.plot.measured_and_simulated(other)
