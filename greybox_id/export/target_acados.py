"""Target `acados`: the files of the target casadi, and a module that builds an AcadosModel from them.

Attributes of AcadosModel as in the acados documentation: name, x, u, p, xdot, f_expl_expr, f_impl_expr,
disc_dyn_expr, x_labels, u_labels, t_label.
"""

from __future__ import annotations

from collections.abc import Mapping

from . import target_casadi
from .memory_equations import MemoryEquations, equations_of
from .memory_equations import shifts_left_out as cautions
from .subject import Subject
from .template import filled

__all__ = ["cautions", "files"]


def files(subject: Subject) -> Mapping[str, bytes]:
    """Name of file -> content. Raises `BadInput` for a hybrid."""
    sampled = isinstance(equations_of(subject), MemoryEquations)
    module = filled("acados_module.py.in", subject.name, SAMPLED=sampled)
    return {**target_casadi.files(subject), f"{subject.name}_acados.py": module.encode()}
