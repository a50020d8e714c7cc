"""Where a fit comes from: the recordings it saw and the steps that led to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..datasets.column_map import ColumnMap, carried_map
from ..datasets.recording import Recording


@dataclass(frozen=True)
class DataRecord:
    """A recording that a fit saw.

    Attributes
    ----------
    role : "train" or "validate".
    name, path, sha256, columns : provenance of the file.
    samples, runs : rows and unbroken runs.
    duration : s.
    between, where : which part of the file it is; empty for all.
    column_map : text of the column map, where it is a user's own.
    """

    role: str
    name: str
    path: str
    sha256: str
    columns: str
    samples: int
    runs: int
    duration: float
    between: str = ""
    where: str = ""
    column_map: str = ""

    @property
    def mapping(self) -> str | ColumnMap:
        """The column map that the recording was read through: the one that was carried along, else by its name."""
        return carried_map(self.columns, self.column_map)


@dataclass(frozen=True)
class Certificate:
    """What Ipopt said of the optimum on the same problem.

    Attributes
    ----------
    status : Ipopt's own words.
    confirmed : whether it converged, without lowering the objective by more than `solvers.ipopt.SAME` of it.
    iterations : its iterations.
    objective_before, objective_after : half the sum of squares.
    gradient : infinity norm of the Lagrangian's gradient at the end (dual infeasibility).
    violation : largest gap in the matching conditions, in the outputs' units.
    cpu_seconds : s.
    """

    status: str
    confirmed: bool
    iterations: int
    objective_before: float
    objective_after: float
    gradient: float
    violation: float
    cpu_seconds: float

    @property
    def gained(self) -> float:
        """Share by which Ipopt lowered the objective."""
        return (self.objective_before - self.objective_after) / max(self.objective_before, 1e-300)


@dataclass(frozen=True)
class Stage:
    """One step of fitting: a part alone, or the closed loop.

    Attributes
    ----------
    model : name of what was fitted.
    closed_loop : whether its own predictions were fed back.
    status : how the solver ended, in words.
    converged : whether it met its tolerance.
    steps : accepted steps.
    history : objective after each step.
    starts : objective reached from each start, the chosen one first.
    strengths : factors on the priors.
    strengths_from : "cross-validation", "early stopping" or "given"; said if it was interrupted.
    tried : strengths tried with their cross-validated error, in noise standard deviations.
    noise : residual standard deviation of each output, in its unit.
    cpu_seconds : s, without cross-validation.
    cross_validation_seconds : s.
    certificate : Ipopt's word, None where it was not asked.
    ended_at : free single numbers by name, where each start ended, in the order of `starts`; empty where that was not
        kept.
    fallbacks : sentences on other ways that were tried because the first one ended badly, and what they gave.
    """

    model: str
    closed_loop: bool
    status: str
    converged: bool
    steps: int
    history: tuple[float, ...]
    starts: tuple[float, ...]
    strengths: Mapping[str, float]
    strengths_from: str
    tried: tuple[tuple[Mapping[str, float], float], ...]
    noise: Mapping[str, float]
    cpu_seconds: float
    cross_validation_seconds: float
    certificate: Certificate | None = None
    ended_at: tuple[Mapping[str, float], ...] = ()
    fallbacks: tuple[str, ...] = ()

    @property
    def confirmed(self) -> bool:
        """Whether it ended at an optimum: Ipopt says so or, where it was not asked, the solver's own tolerance."""
        return self.converged if self.certificate is None else self.certificate.confirmed


def data_record(recording: Recording, role: str) -> DataRecord:
    """Provenance of a recording."""
    source = recording.source
    return DataRecord(
        role, recording.name, source.path, source.sha256, source.columns,
        len(recording), len(recording.runs), recording.duration, source.between, source.where, source.column_map,
    )  # fmt: skip
