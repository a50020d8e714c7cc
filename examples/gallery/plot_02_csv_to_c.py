"""
Your own CSV to C code
======================

Every logger has its own column names. A column map says which column is which signal; then three calls lead to C code.
"""

from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pandas as pd

import greybox_id as gb

folder = Path(mkdtemp())  # where this page writes

# %%
# A file as some logger writes it: speed in km/h, angles in degrees, and a gyro that is mounted upside down.
lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 800)
table = pd.DataFrame(
    {
        "Time": lap.time,
        "Speed_kmh": 3.6 * lap["v_x"],
        "GyroZ": -np.degrees(lap["yaw_rate"]),
        "AccY": lap["a_y"] / 9.80665,
        "servo": np.degrees(lap["steer"]),
    }
)
table.round(4).to_csv(folder / "lap.csv", index=False)
table.head(3)

# %%
# The column map of this file. ``greybox data map lap.csv --out my_car.toml`` proposes such a map.
columns = folder / "my_car.toml"
columns.write_text(
    """name = "my_car"
[time]
column = "Time"
unit = "s"
[signals]
v_x = { column = "Speed_kmh", unit = "km/h" }
yaw_rate = { column = "GyroZ", unit = "deg/s", sign = -1 }
a_y = { column = "AccY", unit = "g" }
steer = { column = "servo", unit = "deg" }
""",
    encoding="utf-8",
)
for finding in gb.check(folder / "lap.csv", columns=columns):
    print(finding.sentence)

# %%
fit = gb.fit("kinematic", folder / "lap.csv", vehicle="roboracer", columns=columns, effects=["steering_delay"])
print(fit)

# %%
# Estimates with their 95 % intervals. Each interval is divided by the magnitude of its estimate.
fit.plot.parameters()

# %%
# C99 code without memory allocation: a step, its derivatives, and a test of the code for the machine that compiles it.
for file in gb.export(fit, to=folder / "car", target="c"):
    print(file.name, file.stat().st_size, "bytes")
print("\n".join((folder / "car" / "car.h").read_text(encoding="utf-8").splitlines()[:40]))
