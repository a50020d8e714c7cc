"""Equations of motion of the virtual vehicle: two tracks, four tyres, a body that rolls.

ISO 8855 axes, SI units; wheels are front left, front right, rear left, rear right. In form "axles" both wheels of an
axle have the slip of its centre, and without effects the vehicle is a single-track model. In form "each_wheel" every
wheel has the slip at its own position (Rajamani, Vehicle Dynamics and Control, 2nd ed., Sec. 8.2).
"""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin, sqrt, tanh

from greybox_id.base.machine_code import compiled

from .layout import (  # fmt: skip
    A_X,
    A_Y,
    ACROSS,
    ALONG,
    ANGLE,
    BRAKE_HEAT,
    F_YF,
    F_YR,
    FORCE,
    FRICTION,
    GUST,
    HEAT_F,
    HEAT_R,
    LAGGED,
    LOAD,
    MASS,
    ROLL,
    ROLL_ACCELERATION,
    ROLL_RATE,
    ROLLING,
    SLOSH,
    SLOSH_RATE,
    STEER,
    TIME,
    V_X,
    V_Y,
    YAW,
    YAW_ACCELERATION,
    YAW_RATE,
    Car,
    Grid,
    Row,
    X,
    Y,
)
from .scale import G
from .tyres import HEAT_BALANCE, LOWER_PEAK, curve, left_beside, load_factor, stiffness_factor, warmth_factor


@compiled
def rear_angle(car: Car, v_x: float, steer: float) -> float:
    """Angle of the rear wheels with rear steering, rad: in phase at high speed, in antiphase at low speed."""
    if car.rear_steer == 0.0:
        return 0.0
    return float(car.rear_steer * steer * tanh((v_x / car.top_speed - 0.3) / 0.15))


@compiled
def asymmetry(car: Car, share: float) -> float:
    """Ratio of the lateral force to that of a symmetric tyre."""
    if car.tyre_asymmetry == 0.0:
        return 1.0
    return float(1.0 + car.tyre_asymmetry * tanh(8.0 * share))


@compiled
def grip_of_road(car: Car, x: float, y: float) -> float:
    """Friction of the road relative to a dry one: slippery patches, three tenths of it, some wheelbases wide."""
    if car.slippery_patches == 0.0:
        return 1.0
    k = 2.0 * pi / (16.0 * car.L)
    height = sin(k * x + 0.4) * cos(0.8 * k * y) + 0.5 * sin(1.7 * k * y + 1.0)
    return float(1.0 - car.slippery_patches * 0.5 * (1.0 + tanh(6.0 * (height - 0.35))))


@compiled
def asked_for(car: Car, v_x: float, steer: float) -> float:
    """Yaw rate that the steering requests, rad/s, limited by the grip."""
    most = 0.8 * G * min(car.D_f, car.D_r) / max(v_x, 1.0)
    return float(min(max(v_x * steer / (car.L + car.understeer * v_x * v_x), -most), most))


@compiled
def moments(
    car: Car, s: Row, given: Row, seen: Row, wheels: Grid, F_xf: float, F_xr: float
) -> tuple[float, float, float]:
    """Additional forces along and across, N, and additional yaw moment, N m, of effects outside the vocabulary.

    Parameters are those of `chassis.motion`, and the longitudinal forces of the axles, N.
    """
    v_x, r = s[V_X], s[YAW_RATE]
    half_f, half_r = 0.5 * car.track_f, 0.5 * car.track_r
    weight = car.m * G
    rolls = tanh(v_x / 0.1)

    F_x = F_y = M_z = 0.0
    # dragging brake and puncture at one wheel each
    brake, flat = car.dragging_brake * weight * rolls, 0.05 * car.puncture * wheels[1, LOAD] * rolls
    F_x -= brake + flat
    M_z += half_f * (brake - flat)
    # limited slip: the faster wheel of a driven axle transfers force to the slower one
    if car.limited_slip != 0.0:
        M_z -= car.limited_slip * half_f * max(F_xf, 0.0) * tanh(20.0 * r * car.track_f / max(v_x, 0.5))
        M_z -= car.limited_slip * half_r * max(F_xr, 0.0) * tanh(20.0 * r * car.track_r / max(v_x, 0.5))
    if car.torque_vectoring != 0.0:
        M_z += car.torque_vectoring * car.I_z * (asked_for(car, v_x, given[STEER]) - r) / (0.3 * car.L / 2.76)
    if car.stability_control != 0.0:
        off = r - asked_for(car, v_x, given[STEER])
        tolerated = 0.04 * G / max(v_x, 1.0)
        beyond = max(abs(off) - tolerated, 0.0) / tolerated
        F = min(0.04 * car.stability_control * beyond, 0.25) * weight * rolls
        F_x -= F
        M_z -= F * half_f * (1.0 if off > 0.0 else -1.0)
    if car.aero_yaw != 0.0:
        M_z += car.aero_yaw * weight * car.L * (v_x / car.top_speed) ** 2 * atan2(s[V_Y], max(v_x, 1.0))
    if given[GUST] != 0.0:
        push = 2.2 * car.c_2 * max(v_x, 0.0) * given[GUST]
        F_y += push
        M_z += 0.15 * car.L * push
    return F_x, F_y, M_z


FRONT_SHARE = 0.55
"""Share of the lateral load transfer that the front axle carries."""
SLIP_STIFFNESS = 15.0
"""Longitudinal force of a rotating wheel per load and slip."""
_LONGITUDINAL_GRIP = 2.0
"""Ratio of longitudinal to lateral peak: with less, brakes could saturate and wheels lock, which are effects."""
_COOLING = 240.0
"""Time constant of cooling tyres, s."""
_SIDE = 1.5
_SLOW = 0.5
_FASTEST = 1500.0
"""Largest rate of relaxation, 1/s, that the integration can follow."""
FORCE_LAGS, LENGTH_GROWS = 1, 2


@compiled
def speed_for_slip(v: float) -> float:
    """Reference speed of slips, m/s: |v| above `_SLOW`, and never less than half of that."""
    return abs(v) if abs(v) > _SLOW else 0.5 * (_SLOW + v * v / _SLOW)


@compiled
def driven(car: Car, s: Row, given: Row) -> tuple[float, float]:
    """Longitudinal forces of the front and rear axle, N."""
    force = given[FORCE]
    if force >= 0.0:
        force *= max(1.0 - car.battery_sag * given[TIME] / 60.0, 0.2)
        return car.drive_split_front * force, (1.0 - car.drive_split_front) * force
    force *= 1.0 - car.brake_fade * s[BRAKE_HEAT]
    if car.brake_cycling > 0.0 and force < -0.4 * car.m * car.brake_max:
        force *= 1.0 - car.brake_cycling * (sin(2.0 * pi * 6.0 * given[TIME] / car.time) > 0.0)
    front = car.brake_split_front + car.brake_bias
    return front * force, (1.0 - front) * force


@compiled
def loads(car: Car, s: Row, given: Row, seen: Row, wheels: Grid) -> None:
    """Write the wheels' loads, N, from the accelerations of the previous evaluation."""
    heavier, v_x = car.mass_change * given[MASS], s[V_X]
    m = car.m * heavier
    down = 0.5 * car.downforce * v_x * v_x / car.L
    to_rear = 0.5 * car.longitudinal_load_transfer * m * seen[A_X] * car.h_cg / car.L
    front = max(car.load_f * heavier + down * car.l_r - to_rear, 0.0)
    rear = max(car.load_r * heavier + down * car.l_f + to_rear, 0.0)
    a_y = seen[A_Y]
    if car.form_roll == 1 and car.roll_dynamics > 0.0:  # load transfer through springs and dampers
        w = 2.0 * pi * car.roll_frequency
        a_y = (s[ROLL] + 2.0 * car.roll_damping / w * s[ROLL_RATE]) / car.roll_dynamics
    moment = m * a_y * car.h_cg
    right_f = min(max(FRONT_SHARE * moment / car.track_f, -front), front)
    right_r = min(max((1.0 - FRONT_SHARE) * moment / car.track_r, -rear), rear)
    wheels[0, LOAD], wheels[1, LOAD] = front - right_f, front + right_f
    wheels[2, LOAD], wheels[3, LOAD] = rear - right_r, rear + right_r


@compiled
def motion(car: Car, s: Row, given: Row, spin: Row, seen: Row, wheels: Grid, rate: Row) -> None:
    """Write d(state)/dt to `rate`, and observed quantities to `seen` and `wheels`.

    Parameters
    ----------
    car : record of constants.
    s : (STATES,) state.
    given : (GIVEN,) road-wheel angle, force and environment.
    spin : (4,) wheel speeds, rad/s; used for rotating wheels.
    seen : (SEEN,) of the previous evaluation, whose accelerations shift loads.
    wheels : (4, WHEEL).
    rate : (STATES,).
    """
    v_x, v_y, r, yaw, steer = s[V_X], s[V_Y], s[YAW_RATE], s[YAW], given[STEER]
    loads(car, s, given, seen, wheels)
    F_xf, F_xr = driven(car, s, given)
    bend_f = steer - car.steering_compliance * seen[F_YF] / (2.0 * car.load_f)
    bend_r = rear_angle(car, v_x, steer) - car.rear_compliance * seen[F_YR] / (2.0 * car.load_r)
    warm_f = warmth_factor(car.form_temperature, car.tyre_temperature, car.tyre_temperature_E_0, s[HEAT_F], s[HEAT_R])
    warm_r = warmth_factor(car.form_temperature, car.tyre_temperature, car.tyre_temperature_E_0, s[HEAT_R], s[HEAT_F])
    grip = car.grip_scale * grip_of_road(car, s[X], s[Y])

    along = across = turning = work_f = work_r = F_yf = F_yr = friction = 0.0
    for axle in range(2):
        front = axle == 0
        D, track, x = (car.D_f, car.track_f, car.l_f) if front else (car.D_r, car.track_r, -car.l_r)
        F_axle, bend = (F_xf, bend_f) if front else (F_xr, bend_r)
        static, warm = (car.load_f, warm_f) if front else (car.load_r, warm_r)
        # peak of the axle first: without differentials, the longitudinal force is divided in proportion to it
        peaks = 0.0
        for i in range(2 * axle, 2 * axle + 2):
            factor = load_factor(car.form_load_sensitivity, car.load_sensitivity, wheels[i, LOAD], static)
            wheels[i, ACROSS] = grip * warm * D * factor * wheels[i, LOAD] * (1.0 - car.puncture if i == 1 else 1.0)
            peaks += wheels[i, ACROSS]
        angle = y = u = w = slip = share = 0.0
        c, d = 1.0, 0.0
        of_left = (0.0, 0.0, 0.0)
        for i in range(2 * axle, 2 * axle + 2):
            left_side = i % 2 == 0
            if left_side or car.spread > 0.0:  # otherwise both wheels have the slip of the axle's centre
                side = 1.0 if left_side else -1.0
                y = car.spread * side * 0.5 * track
                angle = bend + car.spread * side * 0.25 * track / car.L * bend * bend * (1.0 if front else 0.0)
                c, d = cos(angle), sin(angle)
                u, w = v_x - r * y, v_y + r * x
                rolling = speed_for_slip(u)
                slip = angle * u / rolling - atan2(w, rolling)
            peak = wheels[i, ACROSS]
            stiffness = car.front_stiffness if front else car.rear_stiffness
            stiffness *= stiffness_factor(car.form_stiffness, wheels[i, LOAD], static)
            used, lag = slip, 0.0
            if car.tyre_relaxation > 0.0:
                grows = wheels[i, LOAD] / static if car.form_relaxation == LENGTH_GROWS else 1.0
                pace = min(abs(u) / max(car.tyre_relaxation * grows, 1e-9), _FASTEST)
                used = s[LAGGED + i]
                aim = curve(car, front, slip, stiffness) if car.form_relaxation == FORCE_LAGS else slip
                lag = pace * (aim - used)
            rate[LAGGED + i] = lag

            F_x = 0.5 * F_axle if car.spread > 0.0 else (F_axle * peak / peaks if peaks > 0.0 else 0.0)
            if car.form_wheels == 1:
                load = 0.5 * (wheels[2 * axle, LOAD] + wheels[2 * axle + 1, LOAD])
                F_x = rolling_force(car, spin[i], u * c + w * d, load, 0.5 * peaks)
            left = left_beside(car.combined_slip, F_x, peak)
            if left_side or of_left != (used, stiffness, left):
                if car.tyre_relaxation > 0.0 and car.form_relaxation == FORCE_LAGS:
                    share = used * left
                elif car.form_combined == LOWER_PEAK:
                    share = left * curve(car, front, used, stiffness / max(left, 1e-3))
                else:
                    share = left * curve(car, front, used, stiffness)
                of_left = (used, stiffness, left)
            F_y = peak * share * asymmetry(car, share)
            wheels[i, ALONG], wheels[i, ANGLE], wheels[i, ACROSS], wheels[i, ROLLING] = F_x, slip, F_y, u * c + w * d

            f_x, f_y = F_x * c - F_y * d, F_y * c + F_x * d
            along, across, turning = along + f_x, across + f_y, turning + x * f_y - y * f_x
            heat = 0.0
            if car.tyre_temperature != 0.0:
                heat = abs(F_y * sin(slip if car.form_relaxation == FORCE_LAGS else used))
            if front:
                F_yf, work_f = F_yf + F_y, work_f + heat
            else:
                F_yr, work_r = F_yr + F_y, work_r + heat
        friction += 0.5 * grip * warm

    drag_x, drag_y = air(car, v_x, v_y, yaw)
    rolls = 1.0 if v_x > 1.0 else tanh(v_x / 0.1)
    resistance = (car.c_0 + car.rolling_resistance) * rolls + car.c_1 * v_x
    if car.form_drag == 1:  # rolling resistance grows with speed, air drag with slightly less than its square
        share = abs(v_x) / (0.7 * car.top_speed)
        resistance += 0.15 * (share - 1.0) * car.c_0 * rolls
        drag_x *= share**-0.15 if share > 0.1 else 1.0
    more_x, more_y, more_z = moments(car, s, given, seen, wheels, F_xf, F_xr) if car.outside > 0.0 else (0.0, 0.0, 0.0)
    accelerations(
        car, s, given, (along - resistance - drag_x + more_x, across - drag_y + more_y, turning + more_z), seen, rate
    )
    seen[F_YF], seen[F_YR], seen[FRICTION] = F_yf, F_yr, friction

    rates(car, s, given, seen, (work_f, work_r), rate)


@compiled
def accelerations(car: Car, s: Row, given: Row, forces: tuple[float, float, float], seen: Row, rate: Row) -> None:
    """Accelerations from forces along and across [N] and a moment [N m], and rates of sloshing load and roll."""
    along, across, turning = forces
    m = car.m * car.mass_change * given[MASS]
    seen[A_X] = along / m
    if car.sloshing_load > 0.0:  # a share of the mass pushes sideways with its own acceleration
        seen[A_Y] = (across - car.sloshing_load * m * s[SLOSH]) / (m * (1.0 - car.sloshing_load))
        w = 2.0 * pi * 0.8 / car.time
        rate[SLOSH], rate[SLOSH_RATE] = s[SLOSH_RATE], w * w * (seen[A_Y] - s[SLOSH]) - 0.3 * w * s[SLOSH_RATE]
    else:
        seen[A_Y] = across / m
        rate[SLOSH] = rate[SLOSH_RATE] = 0.0
    seen[YAW_ACCELERATION] = turning / (car.I_z * car.yaw_inertia)
    w = 2.0 * pi * car.roll_frequency
    seen[ROLL_ACCELERATION] = (
        w * w * (car.roll_dynamics * seen[A_Y] - s[ROLL]) - 2.0 * car.roll_damping * w * s[ROLL_RATE]
    )


@compiled
def rates(car: Car, s: Row, given: Row, seen: Row, work: tuple[float, float], rate: Row) -> None:
    """The other parts of d(state)/dt: velocities, pose, heat of tyres (`work`, N, of front and rear) and brakes."""
    v_x, v_y, r, yaw, (work_f, work_r) = s[V_X], s[V_Y], s[YAW_RATE], s[YAW], work
    uphill, leftwards = hills(car, s[X], s[Y], yaw)
    rate[V_X] = seen[A_X] + r * v_y - car.weight_along - G * uphill
    rate[V_Y] = seen[A_Y] - r * v_x - car.weight_across - G * leftwards
    rate[YAW_RATE] = seen[YAW_ACCELERATION]
    c, d = cos(yaw), sin(yaw)
    rate[X], rate[Y] = v_x * c - v_y * d, v_x * d + v_y * c
    rate[YAW] = r
    v = hypot(v_x, v_y) if car.tyre_temperature != 0.0 else 0.0
    rate[HEAT_F], rate[HEAT_R] = work_f * v, work_r * v
    if car.form_temperature == HEAT_BALANCE:
        rate[HEAT_F] = 2.0 * work_f * v / car.tyre_temperature_E_0 * (1.0 - s[HEAT_F]) - s[HEAT_F] / _COOLING
        rate[HEAT_R] = 2.0 * work_r * v / car.tyre_temperature_E_0 * (1.0 - s[HEAT_R]) - s[HEAT_R] / _COOLING
    rate[ROLL], rate[ROLL_RATE] = s[ROLL_RATE], seen[ROLL_ACCELERATION]
    rate[BRAKE_HEAT] = 0.0
    if car.brake_fade == 0.0:
        return
    braking = max(-given[FORCE], 0.0) * abs(v_x) / (2.0 * car.m * car.top_speed**2)
    rate[BRAKE_HEAT] = braking * (1.0 - s[BRAKE_HEAT]) - s[BRAKE_HEAT] / 60.0


@compiled
def rolling_force(car: Car, spin: float, rolling: float, load: float, peak: float) -> float:
    """Longitudinal force of a rotating wheel, N, which saturates far above the lateral peak.

    Load and peak are means of the axle's wheels, so that an inner wheel with little load does not lock.
    """
    slip = (spin * car.wheel_radius - rolling) / speed_for_slip(rolling)
    most = max(_LONGITUDINAL_GRIP * peak, 1e-6)
    t = SLIP_STIFFNESS * load * slip / most
    return float(most * t / sqrt(1.0 + t * t))


@compiled
def air(car: Car, v_x: float, v_y: float, yaw: float) -> tuple[float, float]:
    """Drag along and across, N: along the vehicle in still air, otherwise opposite to the relative wind."""
    c_2 = car.c_2 + car.aero_drag
    if car.wind_gust == 0.0:
        return c_2 * abs(v_x) * v_x, 0.0
    towards = car.wind_direction - yaw
    u, w = v_x - car.wind_gust * cos(towards), v_y - car.wind_gust * sin(towards)
    return c_2 * hypot(u, w) * u, c_2 * hypot(u, w) * w * (_SIDE if car.form_wind == 1 else 1.0)


@compiled
def hills(car: Car, x: float, y: float, yaw: float) -> tuple[float, float]:
    """Slope along and across the vehicle, of hills twenty wheelbases apart."""
    if car.road_undulation == 0.0:
        return 0.0, 0.0
    k = 2.0 * pi / (20.0 * car.L)
    east, north = car.road_undulation * cos(k * x), 0.7 * car.road_undulation * sin(1.3 * k * y)
    return east * cos(yaw) + north * sin(yaw), north * cos(yaw) - east * sin(yaw)
