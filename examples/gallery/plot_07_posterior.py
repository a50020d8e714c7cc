"""
The posterior of a fit
======================

Intervals of a fit assume that its errors are linear in the parameters. Draws of the posterior show where they are not.
"""

import greybox_id as gb

lap, other = (gb.read(gb.datasets.shipped(name), columns="roboracer") for name in ("racer_train", "racer_valid"))
fit = gb.fit("kinematic", lap.rows(0, 400), vehicle="roboracer", effects=["steering_delay"])

# %%
# Laplace draws, weighed by the posterior itself. ``method="mcmc"`` samples it where the weights say that this is not
# enough.
posterior = gb.sample(fit, method="laplace", draws=1000, seed=0)
print(posterior.summary())

# %%
# Pairs of parameters: narrow and slanted means identifiable only in combination.
posterior.corner()
