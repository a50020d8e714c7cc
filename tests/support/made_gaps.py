"""Diagnoses made by hand, one of each kind that a person may be shown."""

from dataclasses import replace

import numpy as np

from greybox_id.fitting.scores.horizons import Errors
from greybox_id.gap.estimation.strip import Strip
from greybox_id.gap.estimation.varying import MagnitudeCourse
from greybox_id.gap.estimation.wandering import Wander
from greybox_id.gap.gap import Budget, Closure, Gap, Limit, Moved, Ranked, Share, Unnamed, Where

UNITS = {"v_x": "m/s", "v_y": "m/s", "yaw_rate": "rad/s", "a_x": "m/s^2", "a_y": "m/s^2"}
NOISE = {"v_x": 0.02, "v_y": 0.03, "yaw_rate": 0.012, "a_x": 0.15, "a_y": 0.15}
ALL = tuple(UNITS)
HORIZONS = (0.1, 0.5, 2.0, None)


def strip(channels=ALL, strength=6.0, after=1.15, path=True, seed=0, seconds=60.0):
    """Blocks of half a second of a drive around two bends, with excess in the second."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.25, seconds, 0.5)
    bump = np.exp(-0.5 * ((time - 0.6 * seconds) / (0.08 * seconds)) ** 2)
    scatter = rng.gamma(8.0, 1 / 8.0, (2, len(time)))
    angle = 2 * np.pi * time / seconds
    frequency = np.geomspace(0.2, 25.0, 40)
    peak = strength / (1 + (frequency / 2.0) ** 2)
    gap = rng.gamma(0.4, 1.0, (6, 7)) * np.abs(np.linspace(-1, 1, 7)) ** 2
    gap[0, :2] = gap[0, -2:] = np.nan
    gap = gap / np.nansum(gap) if strength > 0 else np.zeros_like(gap)
    shaky = {c: rng.gamma(30.0, 1 / 30.0, (2, 40)) for c in channels}
    return Strip(
        time=time,
        before=(1 + strength * bump) * scatter[0],
        after=(1 + (after - 1) * bump) * scatter[1],
        x=120 * np.sin(angle) if path else np.empty(0),
        y=60 * np.sin(2 * angle) if path else np.empty(0),
        frequency=frequency,
        spectrum_before={c: (1 + peak) * shaky[c][0] for c in channels},
        spectrum_after={c: (1 + peak * (after - 1) / max(strength, 1e-9)) * shaky[c][1] for c in channels},
        map={"v_x": np.linspace(5, 35, 7), "a_y": np.linspace(-7, 7, 8), "gap": gap, "time": _driven(gap)},
    )


def _driven(gap):
    """Shares of the time: none where the gap is not known."""
    weights = np.where(np.isfinite(gap), 1.0 + np.arange(gap.size).reshape(gap.shape), 0.0)
    return weights / weights.sum()


def errors(channels=ALL, grown=3.0, closed=0.9):
    """Errors at every horizon, that grow to so many times the noise and shrink again."""
    found = []
    for k, channel in enumerate(channels):
        for step, horizon in enumerate(HORIZONS):
            floor = NOISE[channel] * (1 + 0.03 * step)
            before = floor * (1 + (grown - 1) * (step + 1) / 4 / (1 + 0.7 * ((k + 3) % 5)))
            found.append(Errors(channel, UNITS[channel], horizon, before, before - closed * (before - floor), floor))
    return tuple(found)


def closure(recordings=("lap7",), closed=0.88, interval=(0.81, 0.93), before=4.2, channels=ALL, floor=1.02):
    """How far a gap shrinks."""
    return Closure(
        before=before,
        after=before - closed * (before - floor),
        floor=floor,
        closed=closed,
        closed_interval=interval,
        recordings=recordings,
        errors=errors(channels, grown=max(1.02, 1.5 * before**0.5), closed=closed),
    )


LIMITS = {
    "brake_bias": Limit(float("inf"), 0.1, "1", 5200.0, 1.0),
    "front_stiffness": Limit(0.34, 0.85, "1", 2.3, 0.00005),
    "steering_rate_limit": Limit(0.4, 0.5, "rad/s", 1.25, 0.4),
    "mass_change": Limit(0.12, 1.15, "1", 0.8, 0.15),
    "aero_drag": Limit(0.05, 0.2, "N s^2/m^2", 0.25, 0.4),
    "sensor_latency_yaw": Limit(0.0067, 0.03, "s", 0.22, 0.35),
}
"""What would show, the least visible first."""
DELAY = Ranked("steering_delay", 0.94, 0.031, "s", (0.0251, 0.0369), (), 214.0)
LAG = Ranked("steering_lag", 0.31, 0.018, "s", (0.005, 0.06), ("steering_delay",), 190.0)


def clear(**changes):
    """One effect, plainly told, held out."""
    gap = Gap(
        model="single_track",
        recordings=("lap7",),
        doubts=(),
        gap_detected=True,
        p_value=0.0004,
        unknown_probability=0.06,
        unknown="",
        where=Where(
            channel="yaw_rate",
            regime="transient",
            equations={"steering": 0.78, "M_z": 0.15, "sensor a_y": 0.04, "F_y": 0.03},
            time={"from": 31.5, "to": 40.0, "share": 0.14},
            channels={"v_x": 1.04, "v_y": 1.9, "yaw_rate": 3.1, "a_x": 1.0, "a_y": 2.2},
            regimes={
                "straight": (0.41, 0.05),
                "lateral": (0.5, 0.9),
                "high_lateral": (0.2, 0.4),
                "transient": (0.22, 0.78),
                "acceleration": (0.2, 0.18),
                "braking": (0.1, 0.14),
                "combined": (0.07, 0.1),
                "high_speed": (0.3, 0.25),
            },
        ),
        ranking=(
            DELAY,
            replace(LAG, probability=0.04),
            Ranked("sensor_latency_yaw", 0.03, 0.021, "s", (0.012, 0.03), (), 90.0),
            Ranked("tyre_relaxation", 0.02, 0.35, "m", (0.1, 0.6), (), 80.0),
            Ranked("yaw_inertia", 0.004, 1.12, "1", (1.02, 1.22), (), 40.0),
        ),
        applied=("steering_delay",),
        gap=closure(),
        held_out=closure(("lap8",), 0.84, (0.76, 0.9)),
        not_excited={"mass_change": "0.12", "steering_rate_limit": "1.9 rad/s", "aero_drag": "0.05 N s²/m²"},
        absorbed=("front_stiffness",),
        advice=(),
        moved=(Moved("l_f", "m", 1.19, 0.02, 1.233),),
        strip=strip(),
        limits=LIMITS,
        budget=Budget(
            (Share("steering_delay", 0.84, 0.76, 0.9),), Share("unexplained", 0.16, 0.1, 0.24), ("lap8",), True
        ),
        unnamed=Unnamed(0.004, 0.003, 0.02, 0.01, 0.3, 0.4, 21.0, ("B_f", 1.8), {"yaw_rate": 1.02, "a_y": 0.99}),
    )
    found = replace(gap, **changes)
    if found.budget is None:
        return found
    judged = found.held_out or found.gap
    shared = replace(found.budget, recordings=judged.recordings, held_out=found.held_out is not None)
    return replace(found, budget=shared)


def aliased():
    """Two effects that the recording cannot tell apart; nothing held out; the data are doubted."""
    return clear(
        doubts=(
            "lap7: a_y is 18 ms later than yaw_rate v_x says; state it in the column map, or it counts as an effect.",
            "lap7: v_x does not move for 1.2 s (rows 400 to 460): a dead channel?",
        ),
        ranking=(
            replace(DELAY, probability=0.52, indistinguishable_from=("steering_lag",)),
            replace(LAG, probability=0.47),
        ),
        held_out=None,
        advice=("A step of the steering wheel at constant speed would tell steering_delay from steering_lag.",),
    )


def none():
    """No gap."""
    quiet = closure(closed=float("nan"), interval=(float("nan"), float("nan")), before=1.01, floor=1.02)
    quiet = replace(quiet, after=1.01, errors=errors(grown=1.03, closed=0.0))
    return clear(
        gap_detected=False,
        p_value=0.43,
        unknown_probability=0.02,
        where=Where(channels={"v_x": 1.01, "v_y": 1.0, "yaw_rate": 1.04, "a_x": 0.99, "a_y": 1.02}),
        ranking=(replace(LAG, probability=0.05, magnitude=0.002, interval=(0.0, 0.006)),),
        applied=(),
        gap=quiet,
        held_out=replace(quiet, recordings=("lap8",)),
        moved=(),
        strip=strip(strength=0.0, after=1.0),
    )


def unknown():
    """A gap that none of the named effects explains; closing was tried, and made things worse elsewhere."""
    return clear(
        unknown_probability=0.81,
        unknown="A force of bursts on M_z, above 5 Hz, in right-hand turns, that no named effect follows",
        ranking=(
            Ranked("wind_gust", 0.22, 7.5, "m/s", (2.0, 13.0), ("road_bank", "accel_bias_y"), 30.0),
            Ranked("road_bank", 0.18, 0.012, "rad", (0.004, 0.02), ("wind_gust", "accel_bias_y"), 29.0),
        ),
        applied=("wind_gust",),
        gap=closure(closed=0.21, interval=(0.02, 0.38)),
        held_out=closure(("lap8", "lap9"), -0.12, (-0.3, 0.04)),
        strip=strip(strength=6.0, after=5.0),
        resembles=(Wander("road_bank", "rad", 0.012, 3.1, 40.0),),
        courses=(course("time"),),
    )


def varying():
    """A bank along the path beside an effect, verified on another drive."""
    return clear(
        unknown_probability=0.97,
        unknown="the unexplained error is largest in a_y; like road_bank that varies by ± 0.012 rad within 3.1 s",
        resembles=(Wander("road_bank", "rad", 0.012, 3.1, 400.0),),
        courses=(course("path"),),
    )


def course(along):
    """A bank of 12 mrad around a loop, or over a minute."""
    angle = np.linspace(0.0, 2 * np.pi, 30, endpoint=False)
    x, y, yaw = (80 * np.cos(angle), 50 * np.sin(angle), angle) if along == "path" else (np.empty(0),) * 3
    value = 0.012 * np.sin(2 * angle)
    at = angle * (65.0 if along == "path" else 10.0)
    on, sds = ("lap8",) if along == "path" else ("lap7",), np.full(30, 0.004)
    return MagnitudeCourse("road_bank", "rad", along, 0.012, 55.0, at, x, y, yaw, value, sds, 0.61, (0.44, 0.73), on,
                           along == "path")  # fmt: skip


def long_names():
    """Many effects of long names, lopsided and open intervals, extreme magnitudes; two applied."""
    ranking = (
        Ranked("longitudinal_load_transfer", 0.97, 0.41, "1", (0.33, 0.49), ("tyre_temperature",), 80.0),
        Ranked("steering_rate_limit", 0.91, 0.62, "rad/s", (0.55, float("inf")), (), 70.0),
        Ranked("sensor_latency_imu", 0.4, 0.0121, "s", (0.011, 0.0132), ("sensor_latency_yaw", "steering_delay"), 60.0),
        Ranked("rolling_resistance", 0.3, 5321.0, "N", (4800.0, 5800.0), (), 50.0),
        Ranked("imu_mount_pitch", 0.2, 0.0123, "rad", (-0.001, 0.026), (), 44.0),
        Ranked("timestamp_jitter", 0.11, 0.0021, "s", (0.0, 0.004), (), 40.0),
        Ranked("velocity_lever_arm", 0.06, -0.42, "m", (-0.6, -0.24), (), 39.0),
        Ranked("aero_drag", 0.05, 0.000041, "N s^2/m^2", (0.00001, 0.00007), (), 38.0),
    )
    both = ("longitudinal_load_transfer", "steering_rate_limit")
    return clear(
        ranking=ranking,
        applied=both,
        recordings=("2024-05-11_proving_ground_double_lane_change_wet", "2024-05-11_proving_ground_slalom_wet"),
        gap=closure(("2024-05-11_proving_ground_double_lane_change_wet",)),
    )


def without_v_y():
    """A recording that lacks v_y, and a path."""
    fewer = tuple(c for c in ALL if c != "v_y")
    here = closure(channels=fewer)
    return clear(gap=here, held_out=None, strip=strip(fewer, path=False), recordings=("lap7", "lap8"))


CASES = {f.__name__: f for f in (clear, aliased, none, unknown, long_names, without_v_y, varying)}
