"""The single-track vehicle with every effect it may lack, in plain formulas at a fine time step.

Written from the specification of the effects, sharing no code with greybox_id: what CasADi models compute is checked
against this. ISO 8855 axes, SI units, g = 9.81 m/s². Fourth-order Runge-Kutta at steps of at most `fine` seconds that
never straddle an instant at which a command changes or a sensor reads; lags in closed form within a step.

Time: the commands of row k hold from its time until the next row's (hold="zero") or run straight to them ("linear"),
and row k is measured just after they are applied. Before the first row its commands were in force for ever: all
that has memory (steering, motor, tyres, roll) starts settled, the play of the steering centred.
"""

from collections import namedtuple

import numpy as np
from numba import njit
from reference_sensors import SENSOR_EFFECTS, instants, readings

compiled = njit(error_model="numpy")
kept = njit(error_model="numpy", cache=True)  # with all that it calls, which is in this file
G = 9.81
FRONT_SHARE = 0.55  # of the lateral load transfer
SLOW = 0.5  # m/s, below which slip is regularised

FULL_SIZE_CAR = {
    "m": 1457.2, "I_z": 2274.0, "l_f": 1.296, "l_r": 1.465, "h_cg": 0.55, "track_f": 1.55, "track_r": 1.55,
    "B_f": 9.3, "C_f": 1.4, "D_f": 1.0, "E_f": 0.2, "B_r": 10.5, "C_r": 1.4, "D_r": 1.02, "E_r": 0.2,
    "c_0": 208.0, "c_1": 0.0, "c_2": 0.45, "drive_split_front": 0.0, "brake_split_front": 0.62,
    "force_per_unit": 1457.2, "v_max": 50.0,
}  # fmt: skip  # the drive channel is ax_cmd [m/s²]
RACER = {
    "m": 3.5, "I_z": 0.05, "l_f": 0.16, "l_r": 0.17, "h_cg": 0.05, "track_f": 0.24, "track_r": 0.24,
    "B_f": 6.0, "C_f": 1.5, "D_f": 0.9, "E_f": 0.1, "B_r": 7.0, "C_r": 1.5, "D_r": 0.92, "E_r": 0.1,
    "c_0": 0.8, "c_1": 0.25, "c_2": 0.02, "drive_split_front": 0.5, "brake_split_front": 0.5,
    "force_per_unit": 0.9, "v_max": 8.0,
}  # fmt: skip  # 1:10, four driven wheels; the drive channel is motor_current [A]

VEHICLE_EFFECTS = {
    "grip_scale": 1.0, "front_stiffness": 1.0, "rear_stiffness": 1.0, "tyre_relaxation": 0.0, "combined_slip": 0.0,
    "load_sensitivity": 0.0, "longitudinal_load_transfer": 0.0, "tyre_temperature": 0.0, "mass_change": 1.0,
    "cog_shift": 0.0, "yaw_inertia": 1.0, "roll_dynamics": 0.0, "steering_delay": 0.0, "steering_lag": 0.0,
    "steering_bandwidth": np.inf, "steering_rate_limit": np.inf, "steering_offset": 0.0, "steering_ratio": 1.0,
    "steering_backlash": 0.0, "steering_jerk_limit": np.inf, "sensor_quantisation": 0.0, "steering_compliance": 0.0,
    "motor_lag": 0.0, "motor_saturation": np.inf, "motor_gain": 1.0, "brake_bias": 0.0, "aero_drag": 0.0,
    "rolling_resistance": 0.0, "road_slope": 0.0, "road_bank": 0.0, "wind_gust": 0.0, "downforce": 0.0,
}  # fmt: skip
SECOND = {
    "tyre_temperature_E_0": 2e4,  # J
    "grip_scale_slope": 1.0,  # power of it that slopes of the magic formula go with
    "roll_frequency": 1.5,  # Hz
    "roll_damping": 0.3,
    "motor_saturation_v_b": None,  # m/s; 0.6 v_max of the vehicle unless given
    "steering_damping": 0.7,
    "wind_direction": 0.0,  # rad, where to: 0 blows along +x of the world
}
NULL = VEHICLE_EFFECTS | SENSOR_EFFECTS

PARAMETERS = tuple(name for name in FULL_SIZE_CAR if name != "v_max")
Car = namedtuple("Car", (*PARAMETERS, *VEHICLE_EFFECTS, *SECOND))
STATES = ("v_x", "v_y", "yaw_rate", "x", "y", "yaw", "lagged_alpha_f", "lagged_alpha_r", "work", "roll", "roll_rate")
SEEN = (
    "a_x", "a_y", "yaw_acceleration", "roll_acceleration", "alpha_f", "alpha_r", "F_xf", "F_xr", "F_yf", "F_yr",
    "F_zf", "F_zr", "friction", "road_wheel", "slip_f", "slip_r",
)  # fmt: skip
REACH, SHARE = (0.0, 0.5, 0.5, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6)  # Runge-Kutta
TYRES = {"pacejka": 0, "linear": 1, "dugoff": 2, "brush": 3}


# ---- tyres: F_y = D F_z shape(alpha), all with cornering stiffness B C D F_z


@compiled
def shape(tyre, B, C, E, alpha):
    if tyre == 0:  # magic formula
        return np.sin(C * np.arctan(B * alpha - E * (B * alpha - np.arctan(B * alpha))))
    if tyre == 1:
        return B * C * alpha
    t = B * C * np.tan(min(max(alpha, -1.5), 1.5))
    if tyre == 2:  # Dugoff, without longitudinal slip: lambda = mu F_z / (2 C_alpha |tan alpha|)
        return t if abs(t) <= 0.5 else (2 - 0.5 / abs(t)) * 0.5 * np.sign(t)
    z = min(max(t / 3, -1.0), 1.0)  # brush with parabolic pressure (Fiala); slides altogether at |z| = 1
    return 3 * z - 3 * z * abs(z) + z**3


@compiled
def peak(D, F_z, F_z0, k, transfer):
    """Largest lateral force of an axle: left and right wheel, each with the friction of its own load."""
    transfer = min(max(transfer, -F_z / 2), F_z / 2)  # a wheel lifts
    left, right = F_z / 2 - transfer, F_z / 2 + transfer
    return D * (left * (1 - k * (left - F_z0) / F_z0) + right * (1 - k * (right - F_z0) / F_z0))


@compiled
def ellipse(s, F_x, F_peak):
    if s == 0.0:
        return 1.0
    return np.sqrt(max(1 - (s * F_x / F_peak) ** 2, 0.0)) if F_peak > 0 else 0.0


# ---- actuators


@compiled
def first_order(y, u_0, u_1, h, tau):
    """Where a first-order lag is after h seconds of an input running straight from u_0 to u_1."""
    if tau == 0.0:
        return u_1
    behind = tau * (u_1 - u_0) / h
    return u_1 - behind + (y - u_0 + behind) * np.exp(-h / tau)


@compiled
def steering_limit(car, v_x):
    """Largest rate of the road wheels, rad/s: of the actuator, and of a lateral jerk v^2 / L d(steer)/dt."""
    return min(car.steering_rate_limit, car.steering_jerk_limit * (car.l_f + car.l_r) / max(v_x**2, SLOW**2))


@compiled
def steer_jumps(car, steering, command):
    """The command has jumped: what follows it at once. `steering` is play, rate limiter, lag, road wheel, its rate."""
    steering[0] = min(max(steering[0], command - car.steering_backlash), command + car.steering_backlash)
    if car.steering_rate_limit == np.inf and car.steering_jerk_limit == np.inf:
        steering[1] = steering[0]
    if car.steering_lag == 0.0:
        steering[2] = steering[1]
    if car.steering_bandwidth == np.inf:
        steering[3] = steering[2]


@compiled
def servo(car, steering, before, after, h):
    """A servo of second order for h seconds of an input running straight, by Runge-Kutta of fourth order."""
    if car.steering_bandwidth == np.inf:
        steering[3] = after
        return
    w = 2 * np.pi * car.steering_bandwidth
    steps = max(int(np.ceil(w * h / 0.02)), 1)
    dt = h / steps
    for k in range(steps):
        u_0, u_1 = before + (after - before) * k / steps, before + (after - before) * (k + 1) / steps
        x, v = steering[3], steering[4]
        change_x, change_v, dx, dv = 0.0, 0.0, 0.0, 0.0
        for stage in range(4):
            u = u_0 + REACH[stage] * (u_1 - u_0)
            at_x, at_v = x + REACH[stage] * dt * dx, v + REACH[stage] * dt * dv
            dx, dv = at_v, w**2 * (u - at_x) - 2 * car.steering_damping * w * at_v
            change_x += SHARE[stage] * dt * dx
            change_v += SHARE[stage] * dt * dv
        steering[3], steering[4] = x + change_x, v + change_v


@compiled
def steer_moves(car, steering, command, h, v_x):
    """The command has moved for h seconds."""
    before, most, lagged = steering[1], steering_limit(car, v_x) * h, steering[2]
    steering[0] = min(max(steering[0], command - car.steering_backlash), command + car.steering_backlash)
    steering[1] = before + min(max(steering[0] - before, -most), most)
    steering[2] = first_order(steering[2], before, steering[1], h, car.steering_lag)
    servo(car, steering, lagged, steering[2], h)


# ---- equations of motion


@compiled
def dynamics(car, tyre, state, steer, force, given, v_dot, rate, seen):
    """Write d(state)/dt to `rate` and what can be seen of it to `seen`, whose a_x and a_y of before shift the loads.

    `given`: the speed is an input and changes at v_dot.
    """
    v_x, v_y, r, yaw, work, roll, roll_rate = state[0], state[1], state[2], state[5], state[8], state[9], state[10]
    a_x, a_y = seen[0], seen[1]
    l_f, l_r, L = car.l_f, car.l_r, car.l_f + car.l_r

    # loads
    m, more = car.m * car.mass_change, car.mass_change
    static_f, static_r = car.m * G * l_r / L, car.m * G * l_f / L  # of the stated mass: friction is stated at them
    down = car.downforce * v_x**2
    to_rear = car.longitudinal_load_transfer * m * a_x * car.h_cg / L
    F_zf = max(more * static_f + down * l_r / L - to_rear, 0.0)
    F_zr = max(more * static_r + down * l_f / L + to_rear, 0.0)
    to_right_f = FRONT_SHARE * m * a_y * car.h_cg / car.track_f
    to_right_r = (1 - FRONT_SHARE) * m * a_y * car.h_cg / car.track_r

    # longitudinal forces of the axles
    if force > 0:
        limit = car.m * car.motor_saturation
        if v_x > car.motor_saturation_v_b:
            limit *= car.motor_saturation_v_b / v_x
        force = min(force, limit)
        front = car.drive_split_front
    else:
        front = car.brake_split_front + car.brake_bias
    F_xf, F_xr = front * force, (1 - front) * force

    # slip angles; below SLOW the speed they are taken with levels off, and a wheel at rest has no slip from steering
    v = abs(v_x) if abs(v_x) >= SLOW else (v_x**2 + SLOW**2) / (2 * SLOW)
    if car.sensor_quantisation > 0:
        steer = car.sensor_quantisation * np.round(steer / car.sensor_quantisation)
    angle = steer
    slip_f = steer * v_x / v - np.arctan2(v_y + l_f * r, v)
    slip_r = -np.arctan2(v_y - l_r * r, v)
    alpha_f, alpha_r, lag_f, lag_r = slip_f, slip_r, 0.0, 0.0
    if car.tyre_relaxation > 0:
        alpha_f, alpha_r = state[6], state[7]
        lag_r = abs(v_x) / car.tyre_relaxation * (slip_r - alpha_r)

    # lateral forces of the axles
    friction = car.grip_scale * (1 - car.tyre_temperature * (1 - np.exp(-work / car.tyre_temperature_E_0)))
    peak_f = peak(friction * car.D_f, F_zf, static_f / 2, car.load_sensitivity, to_right_f)
    peak_r = peak(friction * car.D_r, F_zr, static_r / 2, car.load_sensitivity, to_right_r)
    steeper = car.grip_scale ** (car.grip_scale_slope - 1) if tyre == 0 else 1.0
    for _ in range(100 if car.steering_compliance > 0 else 1):  # until the wheels have given way
        F_yf = peak_f * shape(tyre, steeper * car.B_f * car.front_stiffness, car.C_f, car.E_f, alpha_f)
        if car.steering_compliance > 0:
            steer = angle - car.steering_compliance * F_yf / F_zf
            slip_f = steer * v_x / v - np.arctan2(v_y + l_f * r, v)
            if car.tyre_relaxation == 0:
                alpha_f = slip_f
    if car.tyre_relaxation > 0:
        lag_f = abs(v_x) / car.tyre_relaxation * (slip_f - alpha_f)
    F_yr = peak_r * shape(tyre, steeper * car.B_r * car.rear_stiffness, car.C_r, car.E_r, alpha_r)
    F_yf *= ellipse(car.combined_slip, F_xf, peak_f)
    F_yr *= ellipse(car.combined_slip, F_xr, peak_r)
    sliding = abs(F_yf * np.sin(alpha_f)) + abs(F_yr * np.sin(alpha_r))

    # drag: along x in still air, against the air speed in wind
    c_2 = car.c_2 + car.aero_drag
    drag_x, drag_y = c_2 * abs(v_x) * v_x, 0.0
    if car.wind_gust != 0:
        air_x = v_x - car.wind_gust * np.cos(car.wind_direction - yaw)
        air_y = v_y - car.wind_gust * np.sin(car.wind_direction - yaw)
        drag_x, drag_y = c_2 * np.hypot(air_x, air_y) * air_x, c_2 * np.hypot(air_x, air_y) * air_y
    rolling = (car.c_0 + car.rolling_resistance) * np.tanh(v_x / 0.1) + car.c_1 * v_x

    # motion; a_x and a_y are specific forces, gravity is not among them
    along_f, across_f = F_xf * np.cos(steer) - F_yf * np.sin(steer), F_yf * np.cos(steer) + F_xf * np.sin(steer)
    uphill, bank = G * np.sin(car.road_slope), G * np.sin(car.road_bank)
    a_x = v_dot - r * v_y + uphill if given else (F_xr + along_f - rolling - drag_x) / m
    a_y = (F_yr + across_f - drag_y) / m
    yaw_acceleration = (l_f * across_f - l_r * F_yr) / (car.I_z * car.yaw_inertia)
    w = 2 * np.pi * car.roll_frequency
    roll_acceleration = w**2 * (car.roll_dynamics * a_y - roll) - 2 * car.roll_damping * w * roll_rate

    put(rate, (
        a_x + r * v_y - uphill, a_y - r * v_x - bank, yaw_acceleration,
        v_x * np.cos(yaw) - v_y * np.sin(yaw), v_x * np.sin(yaw) + v_y * np.cos(yaw), r,
        lag_f, lag_r, sliding * np.hypot(v_x, v_y), roll_rate, roll_acceleration,
    ))  # fmt: skip
    put(seen, (
        a_x, a_y, yaw_acceleration, roll_acceleration, alpha_f, alpha_r, F_xf, F_xr, F_yf, F_yr, F_zf, F_zr, friction,
        steer, slip_f, slip_r,
    ))  # fmt: skip


@compiled
def put(row, values):
    for i in range(len(row)):
        row[i] = values[i]


@kept
def integrate(car, tyre, events, steer, drive, given, v_dot, fine, states, saw):
    """From event to event; steer and drive hold the command [rad] and force [N] just after and just before the next.

    Starts at states[0] and fills states and saw, (events, ...), with how things are just after every event.
    """
    n = states.shape[1]
    state, rate, trial, change = states[0].copy(), states[0].copy(), states[0].copy(), states[0].copy()
    seen = saw[0].copy()
    steering, force = steer[0, 0] * np.array([1.0, 1.0, 1.0, 1.0, 0.0]), drive[0, 0]
    for k in range(len(events)):
        steer_jumps(car, steering, steer[k, 0])
        asked = drive[k, 0]
        force = asked if car.motor_lag == 0 else force
        for _ in range(20 if k == 0 else 5):  # until accelerations and the loads they shift agree
            dynamics(car, tyre, state, steering[3], force, given, v_dot[k], rate, seen)
            if k == 0:  # settled
                state[6], state[7], state[9] = seen[-2], seen[-1], car.roll_dynamics * seen[1]
        put(states[k], state)
        put(saw[k], seen)
        if k + 1 == len(events):
            break
        length = events[k + 1] - events[k]
        step = fine if car.tyre_relaxation == 0 else min(fine, 0.5 * car.tyre_relaxation / (abs(state[0]) + SLOW))
        pieces = max(int(np.ceil(length / step - 1e-6)), 1)
        h = length / pieces
        for j in range(pieces):
            for stage in range(4):  # at the start of the step, twice in its middle, at its end
                if stage == 1 or stage == 3:
                    done, asked_before = (j + REACH[stage]) / pieces, asked
                    asked = drive[k, 0] + done * (drive[k, 1] - drive[k, 0])
                    force = first_order(force, asked_before, asked, h / 2, car.motor_lag)
                    steer_moves(car, steering, steer[k, 0] + done * (steer[k, 1] - steer[k, 0]), h / 2, state[0])
                for i in range(n):
                    trial[i] = state[i] + REACH[stage] * h * rate[i]
                dynamics(car, tyre, trial, steering[3], force, given, v_dot[k], rate, seen)
                for i in range(n):
                    change[i] = (change[i] if stage > 0 else 0.0) + SHARE[stage] * h * rate[i]
            for i in range(n):
                state[i] += change[i]


# ---- what tests call


def simulate(parameters, commands, effects=None, hold="zero", start=(0.0, 0.0, 0.0), fine=1e-4, tyre="pacejka", seed=0):
    """Drive the vehicle: commands time [s], steer [rad], drive [unit of the drive channel], each (n,).

    `start` is v_x, v_y, yaw_rate at the first row. `effects` by name, all others at their null; unknown names are
    refused. `seed` draws jitter and drops. Returns (n,) arrays: v_x, v_y, yaw_rate, a_x, a_y as the sensors read them;
    true_v_x ... true_a_y; and, true, x, y, yaw, F_yf, F_yr, F_xf, F_xr, F_zf, F_zr, alpha_f, alpha_r, road_wheel, roll,
    roll_acceleration, yaw_acceleration, friction (what D is multiplied with), work.
    """
    return _run(parameters, commands, effects, hold, start, fine, tyre, seed, given=False)


def simulate_lateral(
    parameters, commands, effects=None, hold="zero", start=(0.0, 0.0), fine=1e-4, tyre="pacejka", seed=0
):
    """The same with the true speed given: commands time, steer, v_x (straight between rows), and drive or none.

    `start` is v_y, yaw_rate.
    """
    commands = {"drive": np.zeros(len(commands["time"])), **commands}
    return _run(parameters, commands, effects, hold, (commands["v_x"][0], *start), fine, tyre, seed, given=True)


def _run(parameters, commands, effects, hold, start, fine, tyre, seed, given):
    if unknown := set(effects or {}) - set(NULL) - set(SECOND):
        raise ValueError(f"no such effect: {sorted(unknown)}")
    effects = NULL | SECOND | (effects or {})
    car = _car(parameters, effects)
    rng = np.random.default_rng(seed)
    time = np.asarray(commands["time"], float)
    when = instants(time, effects, rng)

    events = np.sort(np.concatenate([time, time + car.steering_delay, *when.values()]))
    events = events[np.diff(events, prepend=-np.inf) > 1e-9]
    steer = car.steering_ratio * np.asarray(commands["steer"], float) + car.steering_offset
    force = car.force_per_unit * car.motor_gain * np.asarray(commands["drive"], float)
    steer = _between(events, time + car.steering_delay, steer, hold)
    force = _between(events, time, force, hold)
    v_dot = np.zeros(len(events))
    if given:
        slopes = np.diff(commands["v_x"]) / np.diff(time)
        v_dot = slopes[np.clip(np.searchsorted(time, events + 1e-9, side="right") - 1, 0, len(slopes) - 1)]
    states, saw = np.zeros((len(events), len(STATES))), np.zeros((len(events), len(SEEN)))
    states[0, :3] = start
    integrate(car, TYRES[tyre], events, steer, force, given, v_dot, float(fine), states, saw)
    log = dict(zip((*STATES, *SEEN), [*states.T, *saw.T], strict=True))

    def true(name, at):
        return log[name][np.searchsorted(events, at, side="right") - 1]

    hidden = ("lagged_alpha_f", "lagged_alpha_r", "slip_f", "slip_r")
    found = {name: true(name, time) for name in log if name not in hidden}
    sensed = readings(true, when, effects, parameters["h_cg"], rng)
    return {"time": time} | found | {f"true_{name}": found[name] for name in sensed} | sensed


def _car(parameters, effects):
    """Parameters and effects under one roof, the centre of gravity where it is."""
    own = {name: float(parameters[name]) for name in PARAMETERS}
    own["l_f"], own["l_r"] = own["l_f"] - effects["cog_shift"], own["l_r"] + effects["cog_shift"]
    lacking = {name: effects[name] for name in (*VEHICLE_EFFECTS, *SECOND)}
    if lacking["motor_saturation_v_b"] is None:
        lacking["motor_saturation_v_b"] = 0.6 * parameters.get("v_max", np.inf)
    return Car(**own, **{name: float(value) for name, value in lacking.items()})


def _between(events, time, values, hold):
    """What is commanded just after every event and just before the next, (n, 2)."""
    if hold == "linear":
        just_after = np.interp(events, time, values)
        return np.column_stack([just_after, np.append(just_after[1:], just_after[-1])])
    if hold != "zero":
        raise ValueError(f'hold is "zero" or "linear", not "{hold}"')
    inside = np.append((events[1:] + events[:-1]) / 2, events[-1] + 1e-9)
    held = values[np.maximum(np.searchsorted(time, inside, side="right") - 1, 0)]
    return np.column_stack([held, held])
