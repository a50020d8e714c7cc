"""Other tools on one problem, as their documentation uses them: each from rows to estimates.

A peer takes time (n,) s, force (n,) N, position (n,) m and where to start (4,), and returns estimates (4,). What is not
installed raises ImportError where it is asked.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from greybox_id.base.shorthands import Array

SHARP = 1e-3
"""m/s: of the tanh that stands for friction's sign."""


def rates(position: Any, velocity: Any, force: Any, theta: Any, tanh: Any = np.tanh) -> tuple[Any, Any]:
    """Derivatives of position and velocity."""
    M, F_v, F_c, F_0 = theta[0], theta[1], theta[2], theta[3]
    del position
    return velocity, (force - F_v * velocity - F_c * tanh(velocity / SHARP) - F_0) / M


def runge_kutta(
    position: Any, velocity: Any, force: Any, theta: Any, step: float, tanh: Any = np.tanh
) -> tuple[Any, Any]:
    """One step of fourth order under a force that is held."""
    a = rates(position, velocity, force, theta, tanh)
    b = rates(position, velocity + step / 2 * a[1], force, theta, tanh)
    c = rates(position, velocity + step / 2 * b[1], force, theta, tanh)
    d = rates(position, velocity + step * c[1], force, theta, tanh)
    return (
        position + step / 6 * (a[0] + 2 * (b[0] + c[0]) + d[0]),
        velocity + step / 6 * (a[1] + 2 * (b[1] + c[1]) + d[1]),
    )


def simulated(theta: Array, start: float, force: Array, step: float) -> Array:
    """(n, ...) positions under a force (n,); theta (4,) or (4, k) for k axes side by side."""
    position = np.full(np.shape(theta)[1:], start)
    velocity = np.zeros_like(position)
    result = np.empty((len(force), *position.shape))
    for k, item in enumerate(force):
        result[k] = position
        position, velocity = runge_kutta(position, velocity, item, theta, step)
    return result


def _residuals(
    time: Array, force: Array, position: Array, start: Array
) -> tuple[Callable[..., Array], Callable[..., Array]]:
    """Residuals and their finite differences over parameters in units of where they start."""
    size, step = scale(start), float(time[1] - time[0])

    def off(x: Array) -> Array:
        result: Array = (simulated(x * size, position[0], force, step) - position) / 1e-3
        return result

    def slope(x: Array) -> Array:
        moved = np.concatenate([[x], x + 1e-6 * np.eye(len(x))])
        many = simulated(moved.T * size[:, None], position[0], force, step) / 1e-3
        result: Array = (many[:, 1:] - many[:, :1]) / 1e-6
        return result

    return off, slope


def scale(start: Array) -> Array:
    """Sizes of parameters: where they start, ten newtons where that is zero."""
    return np.where(start == 0.0, 10.0, start)


def by_scipy(time: Array, force: Array, position: Array, start: Array) -> Array:
    """scipy.optimize.least_squares, Levenberg-Marquardt."""
    from scipy.optimize import least_squares

    off, slope = _residuals(time, force, position, start)
    return np.asarray(least_squares(off, start / scale(start), jac=slope, method="lm").x * scale(start))


def by_casadi(time: Array, force: Array, position: Array, start: Array) -> Array:
    """CasADi's example sysid.py: multiple shooting, Gauss-Newton Hessian, Ipopt."""
    import casadi as cs

    n, size, step = len(time), scale(start), float(time[1] - time[0])
    x, u, theta = cs.MX.sym("x", 2), cs.MX.sym("u"), cs.MX.sym("theta", 4)
    one = cs.Function("one", [x, u, theta], [cs.vertcat(*runge_kutta(x[0], x[1], u, theta * size, step, cs.tanh))])
    states = cs.MX.sym("X", 2, n)
    ends = one.map(n, "serial")(states, force.reshape(1, -1), cs.repmat(theta, 1, n))
    gaps = ends[:, :-1] - states[:, 1:]
    off = (states[0, :] - position.reshape(1, -1)).T / 1e-3
    unknown = cs.veccat(theta, states)
    J = cs.jacobian(off, unknown)
    sigma = cs.MX.sym("sigma")
    hessian = cs.Function("H", {"x": unknown, "lam_f": sigma, "hess_gamma_x_x": sigma * cs.triu(cs.mtimes(J.T, J))},
                          ["x", "p", "lam_f", "lam_g"], ["hess_gamma_x_x"], {"allow_free": False})  # fmt: skip
    quiet = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "hess_lag": hessian}
    solver = cs.nlpsol("solver", "ipopt", {"x": unknown, "f": 0.5 * cs.dot(off, off), "g": cs.vec(gaps)}, quiet)
    guess = np.stack([position, np.gradient(position, step)])
    result = solver(x0=cs.veccat(start / size, guess), lbg=0, ubg=0)["x"]
    return np.asarray(result[:4]).ravel() * size


def by_jax_sysid(time: Array, force: Array, position: Array, start: Array) -> Array:
    """jax-sysid: CTModel, a few hundred steps of Adam, then L-BFGS."""
    import jax.numpy as jnp
    from jax_sysid.models import CTModel

    size = scale(start)

    def state(x: Any, u: Any, t: Any, params: Any) -> Any:
        del t
        return jnp.array(rates(x[0] / 10.0, x[1], u[0], params[0] * size, jnp.tanh)) * jnp.array([10.0, 1.0])

    model = CTModel(2, 1, 1, state_fcn=state, output_fcn=lambda x, u, t, params: x[:1])
    model.init(params=[np.asarray(start / size)], x0=np.array([10.0 * position[0], 0.0]))
    model.loss(rho_x0=0.0, rho_th=0.0, train_x0=False)
    model.optimization(adam_epochs=200, lbfgs_epochs=500, iprint=-1)
    model.integration_options(interpolation_type="zoh", dt0=float(time[1] - time[0]))
    model.fit(10.0 * position.reshape(-1, 1), force.reshape(-1, 1), time)
    return np.asarray(model.params[0]) * size


def by_pypesto(time: Array, force: Array, position: Array, start: Array) -> Array:
    """pyPESTO: residuals and their sensitivities, ScipyOptimizer(ls_trf), one start."""
    import pypesto
    from pypesto.optimize import ScipyOptimizer, minimize

    off, slope = _residuals(time, force, position, start)
    objective = pypesto.Objective(res=off, sres=slope)
    low, high = np.full(4, -10.0), np.full(4, 10.0)
    low[:3] = 1e-2
    problem = pypesto.Problem(objective, low, high, x_guesses=[start / scale(start)])
    result = minimize(problem, ScipyOptimizer("ls_trf"), n_starts=1, progress_bar=False)
    return np.asarray(result.optimize_result.list[0]["x"]) * scale(start)


def by_do_mpc(time: Array, force: Array, position: Array, start: Array) -> Array:
    """do-mpc: a moving-horizon estimator whose parameters are free, over horizons of 20 rows."""
    import casadi as cs
    import do_mpc

    size, step = scale(start), float(time[1] - time[0])
    model = do_mpc.model.Model("discrete")
    x, v = model.set_variable("_x", "x"), model.set_variable("_x", "v")
    u, theta = model.set_variable("_u", "u"), model.set_variable("_p", "theta", shape=(4, 1))
    after = runge_kutta(x, v, u, theta * size, step, cs.tanh)
    model.set_rhs("x", after[0])
    model.set_rhs("v", after[1])
    model.set_meas("x_meas", x, meas_noise=True)
    model.set_meas("u_meas", u, meas_noise=False)
    model.setup()
    mhe = do_mpc.estimator.MHE(model, ["theta"])
    mhe.settings.n_horizon, mhe.settings.t_step, mhe.settings.meas_from_data = 20, step, True
    mhe.settings.supress_ipopt_output()
    mhe.set_default_objective(np.diag([1e4, 1e2]), np.array([[1e8]]), 1e3 * np.eye(4))
    mhe.bounds["lower", "_p_est", "theta"] = np.array([0.1, 0.0, 0.0, -10.0])
    mhe.setup()
    mhe.x0, mhe.p_est0 = np.array([position[0], 0.0]), start / size
    mhe.set_initial_guess()
    for item, pushed in zip(position, force, strict=True):
        mhe.make_step(np.array([item, pushed]))
    return np.asarray(mhe.data["_p", "theta"][-1]).ravel() * size


def by_filterpy(time: Array, force: Array, position: Array, start: Array) -> Array:
    """filterpy: an unscented filter whose state holds the parameters."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    size, step = scale(start), float(time[1] - time[0])

    def ahead(x: Array, dt: float, u: float = 0.0) -> Array:
        return np.array([*runge_kutta(x[0], x[1], u, x[2:] * size, dt), *x[2:]])

    points = MerweScaledSigmaPoints(6, 1e-1, 2.0, -3.0)
    unscented_kalman_filter = UnscentedKalmanFilter(
        dim_x=6, dim_z=1, dt=step, hx=lambda x: x[:1], fx=ahead, points=points
    )
    unscented_kalman_filter.x = np.array([position[0], 0.0, *(start / size)])
    unscented_kalman_filter.P = np.diag([1e-8, 1e-6, 0.3, 0.3, 0.3, 0.3]) ** 1.0
    unscented_kalman_filter.R, unscented_kalman_filter.Q = (
        np.array([[1e-10]]),
        np.diag([1e-14, 1e-10, 1e-10, 1e-10, 1e-10, 1e-10]),
    )
    for k in range(1, len(time)):
        unscented_kalman_filter.predict(u=force[k - 1])
        unscented_kalman_filter.update(position[k])
    return np.asarray(unscented_kalman_filter.x[2:] * size)


def velocity_after(v, F, M, F_v, F_c, F_0):  # type: ignore[no-untyped-def]
    """A Runge-Kutta step of 1 ms, of parameters in units of the nominal ones; nnodely runs the text alone."""
    import torch

    def rate(w):  # type: ignore[no-untyped-def]
        return (F - 150.0 * F_v * w - 15.0 * F_c * torch.tanh(w / 1e-3) - 10.0 * F_0) / (80.0 * M)

    a = rate(v)
    b = rate(v + 0.0005 * a)
    c = rate(v + 0.0005 * b)
    return v + 0.001 / 6 * (a + 2 * (b + c) + rate(v + 0.001 * c))


def position_after(x, v, after):  # type: ignore[no-untyped-def]
    """The position 1 ms later."""
    return x + 0.0005 * (v + after)


def by_nnodely(time: Array, force: Array, position: Array, start: Array) -> Array:
    """nnodely: parametric functions in closed loop over 20 rows, thirty epochs of Adam in torch."""
    import nnodely

    size, step = scale(start), float(time[1] - time[0])
    x, v, u = (nnodely.Input(name) for name in ("x", "v", "F"))
    names = ("M", "F_v", "F_c", "F_0")
    theta = [nnodely.Parameter(name, values=[[float(item)]]) for name, item in zip(names, start / size, strict=True)]
    after = nnodely.ParamFun(velocity_after)(v.last(), u.last(), *theta)
    place = nnodely.ParamFun(position_after)(x.last(), v.last(), after)
    model = nnodely.Modely(visualizer=None, seed=0)
    model.addModel("axis", [nnodely.Output("x_after", place), nnodely.Output("v_after", after)])
    model.addMinimize("off", x.next(), place)
    model.neuralizeModel(step)
    model.loadData("rows", {"x": position, "v": np.gradient(position, step), "F": force})
    model.trainModel(train_dataset="rows", closed_loop={"x": "x_after", "v": "v_after"}, prediction_samples=20,
                     num_of_epochs=30, train_batch_size=64, lr=1e-2)  # fmt: skip
    return np.array([float(np.ravel(model.parameters[name])[0]) for name in names]) * size


EVERY = sys.maxsize
PEERS: dict[str, tuple[Callable[[Array, Array, Array, Array], Array], int, str]] = {
    "scipy least_squares": (by_scipy, EVERY, "scipy.optimize"), "casadi, as its sysid.py": (by_casadi, EVERY, "casadi"),
    "pyPESTO with scipy": (by_pypesto, EVERY, "pypesto.optimize"),
    "jax-sysid": (by_jax_sysid, EVERY, "jax_sysid.models"),
    "filterpy UKF": (by_filterpy, EVERY, "filterpy.kalman"), "do-mpc MHE": (by_do_mpc, 5000, "do_mpc"),
    "nnodely": (by_nnodely, 1000, "nnodely"),
}  # fmt: skip
"""Name -> a peer, how many rows it gets at most, and what it imports; a fifth of the rows in a quick run."""
