"""Clean recordings to check the checks on: a car on a road, sensors with noise, nothing wrong with any of them."""

import numpy as np
from scipy.integrate import cumulative_trapezoid

from greybox_id.datasets.recording import Recording, join


def clean(seed, dt=0.02, seconds=60.0, noise=1.0, wheelbase=2.6, delay=0.06, speed=15.0, name="clean"):
    """A linear single-track car driven by smooth random steering and speed; ISO signs, SI units."""
    rng = np.random.default_rng(seed)
    n = int(seconds / dt)
    time = dt * np.arange(n)
    v_x = speed * (1 + 0.4 * wander(rng, n, dt, 5.0))
    curvature = 0.5 * wander(rng, n, dt, 1.0) * 4.0 / speed**2
    steer = curvature * (wheelbase + 0.002 * speed**2)
    late = np.interp(time - delay, time, steer)
    yaw_rate = v_x * late / (wheelbase + 0.002 * v_x**2)
    v_y = (0.5 * wheelbase - 0.004 * v_x**2) * yaw_rate
    yaw = cumulative_trapezoid(yaw_rate, dx=dt, initial=0.0)
    course = yaw + np.arctan2(v_y, v_x)
    pace = np.hypot(v_x, v_y)
    signals = {
        "v_x": v_x + noise * 0.02 * rng.standard_normal(n),
        "v_y": v_y + noise * 0.01 * rng.standard_normal(n),
        "yaw_rate": yaw_rate + noise * 0.005 * rng.standard_normal(n),
        "a_x": np.gradient(v_x, dt) - yaw_rate * v_y + noise * 0.2 * rng.standard_normal(n),
        "a_y": np.gradient(v_y, dt) + yaw_rate * v_x + noise * 0.2 * rng.standard_normal(n),
        "steer": steer + noise * 0.0005 * rng.standard_normal(n),
        "yaw": np.mod(yaw + np.pi, 2 * np.pi) - np.pi + noise * 0.001 * rng.standard_normal(n),
        "x": cumulative_trapezoid(pace * np.cos(course), dx=dt, initial=0.0) + noise * 0.01 * rng.standard_normal(n),
        "y": cumulative_trapezoid(pace * np.sin(course), dx=dt, initial=0.0) + noise * 0.01 * rng.standard_normal(n),
    }
    signals["latitude"] = 47.5 + np.degrees(signals["y"] / 6.371e6)
    signals["longitude"] = -0.6 + np.degrees(signals["x"] / 6.371e6) / np.cos(np.radians(47.5))
    return Recording(name, time, signals)


def clean_runs(seed, runs=4, **settings):
    """Several clean recordings joined."""
    return join([clean(100 * seed + k, **settings) for k in range(runs)], "clean runs")


def wander(rng, n, dt, period):
    """Smooth random motion of unit size, on time scales of `period` seconds and longer."""
    edge = int(3 * period / dt)
    kernel = np.exp(-0.5 * (np.arange(-edge, edge + 1) * dt / (period / 2)) ** 2)
    raw = np.convolve(rng.standard_normal(n + 2 * edge), kernel, mode="valid")
    return raw / np.std(raw)
