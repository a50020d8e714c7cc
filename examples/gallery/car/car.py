"""single-track vehicle at a measured speed, two degrees of freedom.

From lateral, by greybox-id 1.0.0rc1 with CasADi 3.8.2; load it with that CasADi or a newer one.
x, u, p and y are columns; STATES, INPUTS, PARAMETERS and OUTPUTS say what their entries are, in SI units. P holds the
default parameters. Functions:

    step(x, u, p, dt) -> x_next
    output(x, u, p) -> y
    ode(x, u, p) -> x_dot
    delays(p) -> s
    latencies(p) -> s
    ode_jacobians(x, u, p) -> dx_dot_dx, dx_dot_du
    step_jacobians(x, u, p, dt) -> dx_next_dx, dx_next_du
    output_jacobians(x, u, p) -> dy_dx, dy_du

Inputs are held over a step. Delays of inputs (DELAYED) and latencies of readings (LATE), s by delays(p) and
latencies(p), are no part of these functions: hand in the command that acts.
"""

from pathlib import Path
from typing import NamedTuple

import casadi as cs


class Named(NamedTuple):
    """An entry of a column."""

    name: str
    unit: str
    about: str


STATES = (
    Named("v_y", "m/s", "lateral velocity"),
    Named("yaw_rate", "rad/s", "yaw rate"),
)
INPUTS = (
    Named("steer", "rad", "road-wheel steering angle"),
    Named("v_x", "m/s", "longitudinal velocity"),
)
OUTPUTS = (
    Named("v_y", "m/s", ""),
    Named("yaw_rate", "rad/s", ""),
    Named("a_y", "m/s^2", ""),
)
PARAMETERS = (
    Named("m", "kg", "vehicle mass"),
    Named("I_z", "kg m^2", "yaw inertia"),
    Named("B_f", "1/rad", "stiffness factor, front"),
    Named("C_f", "1", "shape factor, front"),
    Named("D_f", "1", "friction coefficient, front"),
    Named("B_r", "1/rad", "stiffness factor, rear"),
    Named("C_r", "1", "shape factor, rear"),
    Named("D_r", "1", "friction coefficient, rear"),
)
P = cs.DM([1457.2, 2274.0, 9.3, 1.4, 1.0, 10.5, 1.4, 1.02])
DELAYED = ()
LATE = ()

x_index, u_index, p_index, y_index = (
    {own.name: k for k, own in enumerate(entries)} for entries in (STATES, INPUTS, PARAMETERS, OUTPUTS)
)


class Symbols:
    """A column of symbols by name: x.v_x or x["v_x"] is an entry, x.column all of it."""

    def __init__(self, entries, kind=cs.SX):
        if kind is cs.SX:
            self.column = cs.vertcat(*[cs.SX.sym(own.name) for own in entries])
        else:
            self.column = kind.sym("column", len(entries))
        self._index = {own.name: k for k, own in enumerate(entries)}

    def __getitem__(self, name):
        if name not in self._index:
            raise KeyError(f"There is no {name}; there are {', '.join(self._index)}.")
        return self.column[self._index[name]]

    def __getattr__(self, name):
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(error.args[0]) from None


def symbols(kind=cs.SX):
    """Symbols x, u, p; kind is cs.SX or cs.MX."""
    return tuple(Symbols(entries, kind) for entries in (STATES, INPUTS, PARAMETERS))


def state(**values):
    """A column x with these entries, others 0."""
    return _with(cs.DM.zeros(len(STATES)), x_index, values)


def inputs(**values):
    """A column u with these entries, others 0."""
    return _with(cs.DM.zeros(len(INPUTS)), u_index, values)


def parameters(**values):
    """The default parameters with these entries in their place."""
    return _with(cs.DM(P), p_index, values)


def _with(column, index, values):
    for name, value in values.items():
        if name not in index:
            raise KeyError(f"There is no {name}; there are {', '.join(index)}.")
        column[index[name]] = value
    return column


def _load(function):
    here = Path(__file__)
    return cs.Function.deserialize(here.with_name(f"{here.stem}_{function}.casadi").read_text(encoding="utf-8"))


step = _load("step")
output = _load("output")
ode = _load("ode")
delays = _load("delays")
latencies = _load("latencies")
ode_jacobians = _load("ode_jacobians")
step_jacobians = _load("step_jacobians")
output_jacobians = _load("output_jacobians")
