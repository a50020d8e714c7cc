"""Motion models as numbers: one evaluation, a short run by hand, and the matrices of their linearisation."""

import casadi as cs
import numpy as np

from greybox_id.engine.motion.trace import MotionTrace


def vector(model, **values):
    """The model's parameter vector with some of them at other values; a misspelt name is an error."""
    for name, value in values.items():
        model = model.with_parameters(model[name].with_value(value))
    return model.values


def segment(model, h=0.0, **inputs):
    """A segment on which inputs are constant; those not named are zero."""
    assert set(inputs) <= set(model.inputs)
    return np.array([h, *(inputs.get(name, 0.0) for name in model.inputs), *(0.0 for _ in model.inputs)])


def rates(model, z, p=None, **inputs):
    """State name -> derivative."""
    found = MotionTrace(model).rates(z, segment(model, **inputs), model.values if p is None else p)
    return dict(zip((state.name for state in model.states), np.array(found).ravel(), strict=True))


def outputs(model, z, p=None, **inputs):
    """Output name -> reading."""
    found = MotionTrace(model).output(z, segment(model, **inputs), model.values if p is None else p)
    return dict(zip(model.outputs, np.array(found).ravel(), strict=True))


def run(model, z, steps, h, p=None, **inputs):
    """All of z after every step of constant inputs, (steps + 1, size)."""
    trace, s = MotionTrace(model), segment(model, h, **inputs)
    found = [np.asarray(z, dtype=float)]
    for _ in range(steps):
        found.append(np.array(trace.step(found[-1], s, model.values if p is None else p)).ravel())
    return np.array(found)


def matrices(model, z, by, p=None, **inputs):
    """A, B, C, D of small motions about z, from the input `by` to all outputs."""
    trace = MotionTrace(model)
    names = [cs.SX.sym(name, size) for name, size in (("z", trace.size), ("s", trace.segment_size), ("p", model.size))]
    z_, s_, _ = names
    x_dot, y = trace.rates(*names), trace.output(*names)
    column = 1 + model.inputs.index(by)
    wanted = [
        cs.jacobian(x_dot, z_),
        cs.jacobian(x_dot, s_)[:, column],
        cs.jacobian(y, z_),
        cs.jacobian(y, s_)[:, column],
    ]
    at = cs.Function("matrices", names, wanted)
    return [np.array(own) for own in at(z, segment(model, **inputs), model.values if p is None else p)]


def everything_and_its_derivatives(model):
    """(z, s, p) -> rates, readings and a step, and their derivatives by all of z, s and p, in one vector."""
    trace = MotionTrace(model)
    names = [cs.SX.sym(name, size) for name, size in (("z", trace.size), ("s", trace.segment_size), ("p", model.size))]
    found = cs.vertcat(trace.rates(*names), trace.output(*names), trace.step(*names))
    return cs.Function("all", names, [cs.vertcat(found, cs.vec(cs.densify(cs.jacobian(found, cs.vertcat(*names)))))])
