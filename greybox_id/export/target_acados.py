"""Target `acados`: what the target casadi writes, and a module that builds an AcadosModel of it.

Attributes of AcadosModel as the acados documentation names them: name, x, u, p, xdot, f_expl_expr, f_impl_expr,
disc_dyn_expr, x_labels, u_labels, t_label.
"""

from __future__ import annotations

from collections.abc import Mapping

from . import target_casadi
from .memory_equations import MemoryEquations, equations_of
from .memory_equations import shifts_left_out as cautions
from .subject import Subject

__all__ = ["cautions", "files"]


def files(subject: Subject) -> Mapping[str, bytes]:
    """Name of file -> content. Raises `BadInput` for a hybrid."""
    text = _SAMPLED if isinstance(equations_of(subject), MemoryEquations) else _MOVING
    module = _MODULE.replace("DYNAMICS\n", text).replace("NAME", subject.name)
    return {**target_casadi.files(subject), f"{subject.name}_acados.py": module.encode()}


_MODULE = '''"""NAME as an AcadosModel; this folder must be on Python's path.

    ocp.model = NAME_acados.model()
    ocp.parameter_values = NAME_acados.parameter_values()
"""

import casadi as cs
from acados_template import AcadosModel

import NAME


DYNAMICS


def parameter_values():
    """The default parameters as acados takes them."""
    return NAME.P.full().ravel()


def outputs(made):
    """What sensors read, name -> expression of a model's symbols, for costs and constraints."""
    y = NAME.output(made.x, made.u, _p(made))
    return {own.name: y[k] for k, own in enumerate(NAME.OUTPUTS)}


def _begun(fixed):
    x, u, p = NAME.symbols()
    made = AcadosModel()
    made.name = "NAME"
    made.x, made.u = x.column, u.column
    if NAME.PARAMETERS and not fixed:
        made.p = p.column
    made.x_labels = [f"{own.name} [{own.unit}]" for own in NAME.STATES]
    made.u_labels = [f"{own.name} [{own.unit}]" for own in NAME.INPUTS]
    made.t_label = "t [s]"
    return made


def _p(made):
    return made.p if isinstance(made.p, cs.SX) and made.p.numel() else NAME.P
'''

_MOVING = '''def model(dt=None, fixed=False):
    """An AcadosModel.

    dt: length of a step, s, for discrete dynamics besides the continuous ones; acados must take steps as long.
    fixed: with the default parameters as numbers in the equations, and no p.
    """
    made = _begun(fixed)
    made.xdot = cs.SX.sym("xdot", len(NAME.STATES))
    made.f_expl_expr = NAME.ode(made.x, made.u, _p(made))
    made.f_impl_expr = made.xdot - made.f_expl_expr
    if dt is not None:
        made.disc_dyn_expr = NAME.step(made.x, made.u, _p(made), dt)
    return made
'''

_SAMPLED = '''def model(fixed=False):
    """An AcadosModel with discrete dynamics; acados must take steps of NAME.SAMPLE_TIME seconds.

    fixed: with the default parameters as numbers in the equations, and no p.
    """
    made = _begun(fixed)
    made.disc_dyn_expr = NAME.step(made.x, made.u, _p(made))
    return made
'''
