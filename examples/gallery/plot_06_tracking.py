"""
Track cornering stiffness with an EKF
=====================================

A fit gives one value for a whole recording. A filter shows how a parameter changes during the recording, with a
band of uncertainty.
"""

import greybox_id as gb

lap, other = (gb.read(gb.datasets.shipped(name), columns="roboracer") for name in ("racer_train", "racer_valid"))
fit = gb.fit("lateral", lap.rows(0, 600), vehicle="roboracer", effects=["steering_lag"])

# %%
# The stiffnesses of both axles are modelled as random walks; the other parameters are fixed.
track = gb.track(fit, other.rows(0, 400), ["C_alpha_f", "C_alpha_r"])
print(track.summary())

# %%
track.to_pandas()[["time", "C_alpha_f", "C_alpha_f_sd", "C_alpha_r", "C_alpha_r_sd"]].iloc[::80]

# %%
track.plot()
