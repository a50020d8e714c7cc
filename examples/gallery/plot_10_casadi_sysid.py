"""
CasADi's sysid.py and gb.fit compared
=====================================

Two programs estimate the parameters of a servo axis from the same samples and the same starting values: multiple
shooting with Ipopt, as in CasADi's example ``sysid.py``, and ``gb.fit``. Only ``gb.fit`` also estimates the
uncertainty.
"""

import inspect
import time as clock

import numpy as np
import pandas as pd

import greybox_id as gb
from greybox_lab.papers import peers
from greybox_lab.papers.emps import TRUTH, made
from greybox_lab.papers.equations import servo_axis

# %%
# The recording of a servo axis with friction: position and force, six seconds at 1 kHz.
table = made(1).iloc[:6000]
rows = [table[name].to_numpy() for name in ("time", "force", "position")]
start = np.array([float(servo_axis()[name].array) for name in TRUTH])

# %%
# The program written by hand, 20 lines in addition to the equations:
print(inspect.getsource(peers.by_casadi))

# %%
# The CPU times of both programs, and their estimates.
begun = clock.process_time()
by_hand = peers.by_casadi(*rows, start)
middle = clock.process_time()
recording = gb.Recording(
    "axis", rows[0], {"force": rows[1], "position": rows[2]}, extra_units={"force": "N", "position": "m"}
)
fit = gb.fit(servo_axis(), [recording], options=gb.FitOptions(solver="gauss-newton"))
ended = clock.process_time()
print(f"by hand {middle - begun:.2f} CPU s, gb.fit {ended - middle:.2f} CPU s")
pd.DataFrame(
    {"truth": TRUTH, "by hand": dict(zip(TRUTH, by_hand, strict=True)), "gb.fit": fit.params[list(TRUTH)]}
).round(2)

# %%
# Only ``gb.fit`` states how uncertain its estimates are.
fit.plot.parameters()
fit.conf_int().round(1)
