"""Equations of motion of the synthetic racer: a double-track car with four-wheel drive, in plain floats.

ISO 8855 axes, SI units. Wheels are numbered front left, front right, rear left, rear right.

The car differs deliberately from all models that are fitted to it: brush tyres with relaxation, load sensitivity and
friction ellipse, open differentials, a body that rolls and pitches, a steering servo with dead time, rate limit and
lag, and a motor whose force is concave in current and decreases with speed.

Sources: brush tyre with parabolic pressure, Pacejka, Tire and Vehicle Dynamics, 3rd ed., Sec. 3.2; relaxation of
the slip, ibid. Sec. 7.2; double-track equations, Rajamani, Vehicle Dynamics and Control, 2nd ed., Sec. 8.2.2.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import copysign, cos, sin, sqrt, tanh

GRAVITY = 9.81
STEP = 1e-3
"""Integration step, s: the fastest mode, a tyre's torsional spring against the wheel, has about 300 rad/s."""

_SLOWEST_ROLLING = 0.15
"""Speed, m/s, below which slips no longer grow as 1/v; the tyre then behaves as a damper and comes to rest."""

_LOW_SPEED, _LOW_SPEED_DAMPING = 0.5, 0.3
"""Below this speed, m/s, the carcass damps the tyre's lateral spring, s/m; otherwise the car would oscillate on its
tyres long after a stop (Pacejka, 3rd ed., Sec. 8.6)."""

_STICTION_SPEED = 0.03
"""Width, m/s, of the smoothed sign in dry friction."""


@dataclass(frozen=True)
class Car:
    """Constants of the synthetic racer, a 1:10 car of about 3.5 kg.

    Attributes
    ----------
    m, I_z : mass, kg, and yaw inertia, kg m^2.
    l_f, l_r, track : axles to centre of gravity and track width, m.
    h_cg, h_roll : height of the centre of gravity above the road and above the roll and pitch centres, m.
    roll_stiffness, roll_damping, I_roll : N m/rad, N m s/rad, kg m^2.
    pitch_stiffness, pitch_damping, I_pitch : the same about the lateral axis.
    roll_share_f : share of the roll moment that the front axle carries.
    R, I_drive, I_wheel : wheel radius, m; inertia of all that turns with the motor, reduced to the wheels, and of one
        wheel, kg m^2.
    F_z0 : nominal wheel load, N, to which the tyre's constants refer.
    C_x, C_yf, C_yr : slip stiffness over wheel load, 1 (longitudinal; lateral front and rear).
    mu_x, mu_yf, mu_yr : friction coefficients at `F_z0` (longitudinal; lateral front and rear).
    stiffness_fade, mu_fade : relative loss of stiffness and of friction per relative increase in load.
    sigma_x, sigma_y : relaxation lengths, m.
    k_drive, F_drive_max, v_fade : drive force per ampere at low current, N/A; its ceiling, N; speed at which
        it halves, m/s.
    k_brake, F_brake_max : the same for negative current, N/A and N.
    motor_lag : first-order lag from current to force, s.
    F_friction, k_viscous, k_aero : dry friction of driveline and rolling, N; N s/m; air drag, N s^2/m^2.
    steer_gain, steer_trim : road-wheel angle per commanded angle, 1, and offset, rad.
    steer_delay, steer_lag, steer_rate, steer_max : dead time, s; first-order lag, s; rate limit, rad/s; stop of the
        command, rad.
    ackermann : difference of the front wheels' angles per squared angle, relative to the kinematic one.
    """

    m: float = 3.5
    I_z: float = 0.045
    l_f: float = 0.163
    l_r: float = 0.157
    track: float = 0.24
    h_cg: float = 0.07
    h_roll: float = 0.055
    roll_stiffness: float = 20.0
    roll_damping: float = 0.5
    I_roll: float = 0.018
    pitch_stiffness: float = 22.0
    pitch_damping: float = 0.6
    I_pitch: float = 0.04
    roll_share_f: float = 0.56
    R: float = 0.054
    I_drive: float = 1.1e-3
    I_wheel: float = 1.0e-4
    F_z0: float = 8.6
    C_x: float = 12.0
    C_yf: float = 7.5
    C_yr: float = 10.0
    mu_x: float = 0.78
    mu_yf: float = 0.60
    mu_yr: float = 0.70
    stiffness_fade: float = 0.15
    mu_fade: float = 0.1
    sigma_x: float = 0.03
    sigma_y: float = 0.05
    k_drive: float = 9.0
    F_drive_max: float = 28.0
    v_fade: float = 3.0
    k_brake: float = 9.5
    F_brake_max: float = 25.0
    motor_lag: float = 0.03
    F_friction: float = 3.0
    k_viscous: float = 0.35
    k_aero: float = 0.05
    steer_gain: float = 1.09
    steer_trim: float = -0.006
    steer_delay: float = 0.02
    steer_lag: float = 0.035
    steer_rate: float = 3.4
    steer_max: float = 0.419
    ackermann: float = 0.7

    @property
    def wheelbase(self) -> float:
        """Distance between the axles, m."""
        return self.l_f + self.l_r


@dataclass
class CarMotion:
    """State of the car. SI units, velocities in the car's axes; zero everywhere is standstill on flat ground."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    v_x: float = 0.0
    v_y: float = 0.0
    yaw_rate: float = 0.0
    a_x: float = 0.0
    a_y: float = 0.0
    yaw_acceleration: float = 0.0
    roll: float = 0.0
    roll_rate: float = 0.0
    pitch: float = 0.0
    pitch_rate: float = 0.0
    drive_speed: float = 0.0
    split_f: float = 0.0
    split_r: float = 0.0
    steer: float = 0.0
    drive_force: float = 0.0
    slip_x: list[float] = field(default_factory=lambda: [0.0] * 4)
    slip_y: list[float] = field(default_factory=lambda: [0.0] * 4)
    waiting_steer: deque[float] = field(default_factory=deque)


def brush(car: Car, slip_x: float, slip_y: float, C_y: float, mu_y: float, F_z: float) -> tuple[float, float]:
    """Forces of a brush tyre with parabolic pressure and a friction ellipse.

    Parameters
    ----------
    car : tyre constants.
    slip_x, slip_y : relaxed slips, 1; positive slip makes positive force.
    C_y, mu_y : lateral slip stiffness over load and friction coefficient, 1.
    F_z : wheel load, N.

    Returns
    -------
    F_x, F_y : N. Pacejka, 3rd ed., Sec. 3.2, on slips scaled by each direction's friction limit.
    """
    excess = F_z / car.F_z0 - 1.0
    stiffness = 1.0 - car.stiffness_fade * excess
    friction = 1.0 - car.mu_fade * excess
    mu_x, mu_y = car.mu_x * friction, mu_y * friction
    p_x = car.C_x * stiffness * slip_x / mu_x
    p_y = C_y * stiffness * slip_y / mu_y
    p = sqrt(p_x * p_x + p_y * p_y)
    # p/3 is the sliding share of the contact patch; from 1 on all of it slides.
    share = 1.0 - p / 3.0 + p * p / 27.0 if p < 3.0 else 1.0 / p
    return mu_x * F_z * share * p_x, mu_y * F_z * share * p_y


def motor_force(car: Car, current: float, speed: float) -> float:
    """Steady force of the motor at the wheels, N: concave in current, lower at speed; braking has its own map."""
    if current >= 0.0:
        return car.F_drive_max * tanh(car.k_drive * current / car.F_drive_max) / (1.0 + abs(speed) / car.v_fade)
    # A motor at rest has no back-EMF to brake with.
    grip = tanh(speed / 0.25)
    return car.F_brake_max * tanh(car.k_brake * current / car.F_brake_max) * grip


def advance(car: Car, q: CarMotion, steer_command: float, current: float) -> None:
    """Advance the state by one `STEP`, in place.

    Semi-implicit Euler: slips first, forces from the new slips, then velocities, then positions. The tyre is a
    spring in series with a damper, and this order keeps the spring from gaining energy.

    Parameters
    ----------
    car, q : constants and state.
    steer_command : commanded road-wheel angle, rad.
    current : motor current, A; negative brakes.
    """
    dt = STEP
    # Steering servo: dead time, lag, rate limit.
    if not q.waiting_steer:
        q.waiting_steer.extend([0.0] * round(car.steer_delay / dt))
    q.waiting_steer.append(max(-car.steer_max, min(car.steer_max, steer_command)))
    target = car.steer_gain * q.waiting_steer.popleft() + car.steer_trim
    q.steer += dt * max(-car.steer_rate, min(car.steer_rate, (target - q.steer) / car.steer_lag))
    half = 0.5 * car.track
    spread = car.ackermann * half / car.wheelbase * q.steer * q.steer

    # Wheel loads: static, body roll on its springs, and pitching moment.
    weight_f = car.m * GRAVITY * car.l_r / car.wheelbase
    weight_r = car.m * GRAVITY - weight_f
    to_rear = car.m * car.h_cg * q.a_x / car.wheelbase
    # The springs carry the moment above the roll axis with a lag, the links the rest immediately.
    roll_moment = car.roll_stiffness * q.roll + car.roll_damping * q.roll_rate
    roll_moment += car.m * q.a_y * (car.h_cg - car.h_roll)
    shift_f = car.roll_share_f * roll_moment / car.track
    shift_r = (1.0 - car.roll_share_f) * roll_moment / car.track
    front, rear = 0.5 * (weight_f - to_rear), 0.5 * (weight_r + to_rear)
    loads = (front - shift_f, front + shift_f, rear - shift_r, rear + shift_r)

    # Tyres.
    omega = q.drive_speed
    wheels = (
        (car.l_f, half, q.steer + spread, omega - q.split_f, car.C_yf, car.mu_yf),
        (car.l_f, -half, q.steer - spread, omega + q.split_f, car.C_yf, car.mu_yf),
        (-car.l_r, half, 0.0, omega - q.split_r, car.C_yr, car.mu_yr),
        (-car.l_r, -half, 0.0, omega + q.split_r, car.C_yr, car.mu_yr),
    )
    F_x = F_y = M_z = 0.0
    traction = [0.0] * 4
    for k, (a, b, angle, wheel_speed, C_y, mu_y) in enumerate(wheels):
        u, w = q.v_x - q.yaw_rate * b, q.v_y + q.yaw_rate * a
        c, s = cos(angle), sin(angle)
        along, across = u * c + w * s, w * c - u * s
        rolling = wheel_speed * car.R
        reference = max(abs(along), abs(rolling), _SLOWEST_ROLLING)
        q.slip_x[k] = (q.slip_x[k] + dt * (rolling - along) / car.sigma_x) / (1.0 + dt * reference / car.sigma_x)
        q.slip_y[k] = (q.slip_y[k] - dt * across / car.sigma_y) / (1.0 + dt * reference / car.sigma_y)
        damping = _LOW_SPEED_DAMPING * max(0.0, 1.0 - reference / _LOW_SPEED)
        T_x, T_y = brush(car, q.slip_x[k], q.slip_y[k] - damping * across, C_y, mu_y, max(loads[k], 0.1))
        traction[k] = T_x
        f_x, f_y = T_x * c - T_y * s, T_x * s + T_y * c
        F_x += f_x
        F_y += f_y
        M_z += a * f_y - b * f_x

    # Motor, driveline with open differentials (the centre is a rigid shaft), dry and viscous friction.
    rolling = omega * car.R
    q.drive_force += dt / car.motor_lag * (motor_force(car, current, rolling) - q.drive_force)
    drag = car.F_friction * tanh(rolling / _STICTION_SPEED) + car.k_viscous * rolling
    q.drive_speed += dt * car.R * (q.drive_force - drag - sum(traction)) / car.I_drive
    # The grease of a differential slowly equalises the speeds of the two wheels.
    q.split_f += dt * (0.5 * car.R * (traction[0] - traction[1]) / car.I_wheel - 2.0 * q.split_f)
    q.split_r += dt * (0.5 * car.R * (traction[2] - traction[3]) / car.I_wheel - 2.0 * q.split_r)

    # Body.
    F_x -= copysign(car.k_aero * q.v_x * q.v_x, q.v_x)
    q.a_x, q.a_y, q.yaw_acceleration = F_x / car.m, F_y / car.m, M_z / car.I_z
    v_x = q.v_x + dt * (q.a_x + q.yaw_rate * q.v_y)
    q.v_y += dt * (q.a_y - q.yaw_rate * q.v_x)
    q.v_x = v_x
    q.yaw_rate += dt * q.yaw_acceleration
    q.yaw += dt * q.yaw_rate
    c, s = cos(q.yaw), sin(q.yaw)
    q.x += dt * (q.v_x * c - q.v_y * s)
    q.y += dt * (q.v_x * s + q.v_y * c)
    lean = car.m * q.a_y * car.h_roll - car.roll_stiffness * q.roll - car.roll_damping * q.roll_rate
    q.roll_rate += dt * lean / car.I_roll
    q.roll += dt * q.roll_rate
    # Pitch is positive nose down: braking pitches the car.
    dive = -car.m * q.a_x * car.h_roll - car.pitch_stiffness * q.pitch - car.pitch_damping * q.pitch_rate
    q.pitch_rate += dt * dive / car.I_pitch
    q.pitch += dt * q.pitch_rate
