import casadi as ca

import greybox_id as gb


def dynamics(x, u, p, q):
    q.settled = u.v_x * ca.tan(u.steer) / (p.L + p.K_us * u.v_x**2)
    return {"yaw_rate": (q.settled - x.yaw_rate) / p.yaw_lag}


own_model = gb.models.MotionModel(
    name="slow_turner", about="yaw rate that settles where understeer puts it", dynamics=dynamics,
    states=(gb.models.State("yaw_rate", "rad/s"),), inputs=("steer", "v_x"), outputs=("yaw_rate",), commands=("steer",),
    quantities=("settled",), parameters=(
        gb.models.Parameter("L", "m", 0.33, (0.1, 1.0), about="wheelbase"),
        gb.models.Parameter("K_us", "rad s^2/m", 0.0, (-0.01, 0.2), about="understeer gradient"),
        gb.models.Parameter("yaw_lag", "s", 0.1, (0.005, 2.0), about="time constant of the yaw rate")),
)  # fmt: skip
