"""Files of the truck's kind, made up."""

import numpy as np
import pandas as pd
from scipy.signal import lfilter


def truck_file(path, chunks, seed):
    """A made-up file of the truck's kind: 200 Hz, 10 s a trajectory, signs mixed as there."""
    rng, time, tables = np.random.default_rng(seed), np.arange(2000) / 200, []
    for number in range(chunks):
        steer = 0.03 * np.sin(2 * np.pi * rng.uniform(0.1, 0.4) * time + rng.uniform(0, 6)) + 0.01
        v_x = 12.0 + rng.uniform(-3, 3) + 0.3 * np.sin(time)
        yaw_rate = lfilter([0.02], [1, -0.98], v_x * steer / (4.8 + 0.02 * v_x**2))
        v_y = lfilter([0.05], [1, -0.95], (1.0 - 0.02 * v_x**2) * yaw_rate)
        noise = 0.01 * rng.standard_normal((2, 2000))
        tables.append(
            pd.DataFrame(
                {
                    "trajectory": 10 * number, "time": time, "vx": v_x, "vy": v_y + noise[0],
                    "psidt": -yaw_rate + 0.1 * noise[1], "alpha1": -steer, "alpha2": -steer, "alpha": -steer,
                    "long": -0.6355 + 1e-4 * time, "lat": 47.5342 + 1e-4 * time,
                }
            )
        )  # fmt: skip
    pd.concat(tables, ignore_index=True).to_parquet(path)
