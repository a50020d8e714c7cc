"""Priors as residuals: every Gaussian belief about the parameters as rows of a least-squares problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp

from ..parameter import Array, Parameter, Prior
from .trace import Index


def prior_rows(
    parameters: Sequence[Parameter], strengths: Mapping[str, float] | None = None
) -> tuple[sp.csr_matrix, Array]:
    """Rows R and offsets r so that the priors' residuals are R p - r, in standard deviations.

    Parameters
    ----------
    parameters : in the order of the parameter vector p.
    strengths : name of a prior's strength -> factor by which its standard deviations are divided.

    Returns
    -------
    (rows, parameters) sparse matrix, (rows,) offsets.
    """
    strengths = strengths or {}
    blocks: list[tuple[Index, Array, Array]] = []  # entry indices (rows, terms), coefficients, offsets
    start = 0
    for parameter in parameters:
        index = start + np.arange(parameter.size).reshape(parameter.shape)
        start += parameter.size
        if parameter.prior is not None:
            blocks += _rows(parameter, parameter.prior, index, strengths.get(parameter.prior.strength, 1.0))
    if not blocks:
        return sp.csr_matrix((0, start)), np.empty(0)
    matrices: list[sp.csr_matrix] = [
        sp.csr_matrix((c.ravel(), (np.repeat(np.arange(len(i)), i.shape[1]), i.ravel())), shape=(len(i), start))
        for i, c, _ in blocks
    ]
    return sp.vstack(matrices, format="csr"), np.concatenate([offsets for _, _, offsets in blocks])


def _rows(parameter: Parameter, prior: Prior, index: Index, strength: float) -> list[tuple[Index, Array, Array]]:
    mean = np.broadcast_to(parameter.array if prior.mean is None else np.asarray(prior.mean, float), parameter.shape)
    weight = strength / np.broadcast_to(np.asarray(prior.sd, float), parameter.shape).reshape(-1, 1)
    told = weight[:, 0] > 0.0
    rows = [(index.reshape(-1, 1)[told], weight[told], (mean.reshape(-1, 1) * weight)[told, 0])]
    for axis, sd in enumerate(prior.step_sd):
        if sd is None or parameter.shape[axis] < 2:
            continue
        before = np.take(index, range(parameter.shape[axis] - 1), axis).reshape(-1, 1)
        after = np.take(index, range(1, parameter.shape[axis]), axis).reshape(-1, 1)
        steps = np.diff(mean, axis=axis)
        weight = strength / np.broadcast_to(np.asarray(sd, float), steps.shape).reshape(-1, 1)
        rows.append((np.hstack([before, after]), np.hstack([-weight, weight]), steps.ravel() * weight[:, 0]))
    return rows
