"""
The posterior of a fit
======================

The intervals of a fit assume that its residuals are linear in the parameters. Draws of the posterior show where this
assumption fails.
"""

import matplotlib.pyplot as plt

import greybox_id as gb

lap, other = (gb.read(gb.datasets.shipped(name), columns="roboracer") for name in ("racer_train", "racer_valid"))
fit = gb.fit("kinematic", lap.rows(0, 800), vehicle="roboracer", effects=["steering_delay"])

# %%
# Laplace draws, weighted by the posterior. If the weights show that Laplace draws are not enough, sample the posterior
# itself with ``method="mcmc"``.
posterior = gb.sample(fit, method="laplace", draws=1000, seed=0)
print(posterior.summary())

# %%
# The steering's dead time: draws of the posterior, and the interval of the fit. Both include the error of the model's
# form. The draws of the noise alone assume that the equations are exact; they are much narrower.
fig, ax = plt.subplots(figsize=(6.4, 3.0), layout="constrained")
ax.axvspan(*fit.conf_int().loc["steering_delay"], color="#f8dcc4", label="95 % interval of the fit")
place = posterior.names.index("steering_delay")
for draws, color, label in (
    (posterior.noise_alone[:, place], "#e69f00", "draws of the noise alone"),
    (posterior.values[:, place], "#0072b2", "draws of the posterior"),
):
    ax.hist(draws, weights=posterior.weight, bins=30, density=True, histtype="step", color=color, label=label)
ax.set(title="Steering delay of the 1:10 car", xlabel="steering delay [s]", ylabel="density [1/s]")
ax.legend()

# %%
# The draws over pairs of parameters: if they form a narrow, slanted band, the two parameters are identifiable only in
# combination.
posterior.corner()
