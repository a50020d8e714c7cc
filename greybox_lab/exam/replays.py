"""Simulation of a recording from its own commands, with other effects and without noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2

from greybox_id.base.shorthands import Array

from ..virtual.virtual_vehicle import Tolerances
from .aliases import DISTINGUISHABLE, View

LIKELY = 0.95
"""Probability of the region around the stated values to which deviations within tolerances are limited here."""
GLANCE = 15.0
"""Duration of the part of the recording, s, that may exclude an alias before the whole is simulated."""


class Drive(Protocol):
    """Simulates other vehicles with the same commands."""

    def __call__(self, effects: Mapping[str, float], rows: int, beyond: str) -> Mapping[str, Array]:
        """Noise-free readings by channel, (rows,) each.

        Parameters
        ----------
        effects : instead of the true ones; tolerated small effects remain.
        rows : of the recording, from its first.
        beyond : parameter or effect with a tolerance, which is shifted by one sd of it; "" for none.
        """


@dataclass(frozen=True)
class Replays:
    """A recording that can be simulated with other effects.

    Attributes
    ----------
    drive : simulates it.
    noise : sd by channel.
    rows, period : of the recording.
    tolerances : as stated; None if the vehicle file is exact.
    form : difference between the model and a vehicle without effects, due to its form, as `readings`: causes that
        differ by no more than this are indistinguishable. None if the forms are equal.
    """

    drive: Drive
    noise: Mapping[str, float]
    rows: int
    period: float
    tolerances: Tolerances | None
    form: Array | None = None
    _seen: dict[object, Array] = field(default_factory=dict)

    def readings(self, effects: Mapping[str, float], part: bool = False, beyond: str = "") -> Array:
        """Noise-free readings in noise sds, (channels, n).

        Parameters
        ----------
        effects : instead of the true ones; tolerated small effects remain.
        part : whether only the first seconds.
        beyond : parameter or effect with a tolerance, which is shifted by one sd of it.
        """
        key = part, beyond, *sorted(effects.items())
        if key not in self._seen:
            rows = min(round(GLANCE / self.period), self.rows) if part else self.rows
            result = self.drive(effects, rows, beyond)
            self._seen[key] = np.stack([result[name] / sd for name, sd in self.noise.items()])
        return self._seen[key]

    def size(self, effects: Mapping[str, float], rest: Mapping[str, float]) -> dict[str, float]:
        """Channel -> root mean square of the difference that effects make in addition to the rest, in noise sds."""
        return self._by_channel(self.readings(effects) - self.readings(rest))

    def left(self, effects: Mapping[str, float], rest: Mapping[str, float]) -> dict[str, float]:
        """Likewise, after refitting within the likely range of tolerances."""
        return self.beside_tolerances(self.readings(effects) - self.readings(rest))

    def beside_tolerances(self, difference: Array, others: Sequence[Array] = ()) -> dict[str, float]:
        """Channel -> root mean square of a difference of readings after refitting within tolerances.

        Parameters
        ----------
        others : differences by other causes, which are projected out, too.
        """
        left = difference.ravel()
        if not np.any(left):
            return self._by_channel(difference)
        basis, _ = np.linalg.qr(np.stack([other.ravel() for other in others], axis=1)) if others else (None, None)

        def beside(rows: Array) -> Array:
            return rows if basis is None else rows - (rows @ basis) @ basis.T

        left = beside(left)
        if self.tolerances is not None:
            shifts = beside(self._shifts(False))
            left = left - _likely(shifts @ shifts.T, shifts @ left) @ shifts
        return self._by_channel(left.reshape(difference.shape))

    def _by_channel(self, difference: Array) -> dict[str, float]:
        sizes = np.sqrt(np.mean(difference**2, axis=1))
        return {name: float(size) for name, size in zip(self.noise, sizes, strict=True)}

    def views(self) -> Sequence[View]:
        """The first seconds, and the whole recording."""
        return self._view(True), self._view(False)

    def _view(self, part: bool) -> View:
        shifts = self._shifts(part)
        inner = _inner(shifts)

        def product(a: Array, b: Array) -> float:
            return float(np.sum(a * b) - (shifts @ a.ravel()) @ inner @ (shifts @ b.ravel()))

        threshold = DISTINGUISHABLE
        if self.form is not None:
            form = self.form[:, : self.readings({}, part).shape[1]]
            threshold = max(DISTINGUISHABLE, product(form, form))
        return View(lambda other: self.readings(other, part), product, threshold)

    def _shifts(self, part: bool) -> Array:
        """Influence of one sd of every tolerance, (tolerances, readings)."""
        known, base = self.tolerances, self.readings({})
        rows = self.readings({}, part).shape[1]
        names = () if known is None else (*known.parameters, *known.effects)
        shifts = np.zeros((len(names), len(base), rows))
        for k, name in enumerate(names):
            shifts[k] = (self.readings({}, beyond=name) - base)[:, :rows]
        return shifts.reshape(len(names), len(base) * rows)


def _likely(gram: Array, aim: Array) -> Array:
    """Deviations in sds of tolerances that best explain an aim, limited to the region of probability `LIKELY`."""
    values, vectors = np.linalg.eigh(gram)
    projected, most = vectors.T @ aim, float(chi2.ppf(LIKELY, len(aim)))

    def length(log_held: float) -> float:
        return float(np.sum((projected / (values + np.exp(log_held))) ** 2)) - most

    least, greatest = np.log(1e-9 * values[-1] + 1e-300), np.log(np.linalg.norm(projected) / np.sqrt(most) + 1e-300)
    held = least if length(least) <= 0 else brentq(length, least, max(greatest, least) + 1.0)
    return np.asarray(vectors @ (projected / (np.maximum(values, 0.0) + np.exp(held))))


def _inner(shifts: Array) -> Array:
    """Posterior covariance of deviations within tolerances, in their sds, given the readings and unit priors."""
    return np.asarray(np.linalg.inv(np.eye(len(shifts)) + shifts @ shifts.T))
