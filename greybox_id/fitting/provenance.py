"""Provenance of a fit: its recordings, and the steps of the fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..datasets.column_map import ColumnMap, carried_map
from ..datasets.recording import Recording


@dataclass(frozen=True)
class DataRecord:
    """A recording used by a fit.

    Attributes
    ----------
    role : "train" or "validate".
    name, path, sha256, columns : provenance of the file.
    samples, runs : rows and unbroken runs.
    duration : s.
    between, where : the part of the file that was used; empty for all.
    column_map : text of the column map, if it is a user's.
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
        """The recording's column map: the stored text, else the name of a shipped one."""
        return carried_map(self.columns, self.column_map)


@dataclass(frozen=True)
class Certificate:
    """Ipopt's report on the optimum of the same problem.

    Attributes
    ----------
    status : Ipopt's return status.
    confirmed : whether it converged, without lowering the objective by more than the share `solvers.ipopt.SAME`.
    iterations : its iterations.
    objective_before, objective_after : half the sum of squares.
    gradient : infinity norm of the Lagrangian's gradient at the end (dual infeasibility).
    violation : largest constraint violation at the end; bounds are the only constraints.
    cpu_seconds : CPU time, s.
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
        """Relative decrease of the objective by Ipopt."""
        return (self.objective_before - self.objective_after) / max(self.objective_before, 1e-300)


@dataclass(frozen=True)
class Stage:
    """One step of fitting: a part alone, or the closed loop.

    Attributes
    ----------
    model : name of the fitted part or model.
    closed_loop : whether its predictions were fed back.
    status : how the solver ended, in words.
    converged : whether it met its tolerance.
    steps : accepted steps.
    history : objective after each step.
    starts : final objective of each start, the chosen one first.
    strengths : factors on the priors.
    strengths_from : "cross-validation", "early stopping" or "given"; mentions an interruption.
    tried : strengths tried with their cross-validated error, in noise standard deviations.
    noise : residual standard deviation of each output, in its unit.
    cpu_seconds : CPU time without cross-validation, s.
    cross_validation_seconds : CPU time of cross-validation, s.
    certificate : Ipopt's report; None if it was not run.
    ended_at : for each start, in the order of `starts`, name -> final value of the free scalar parameters; or empty.
    fallbacks : sentences on other ways that were tried because the first one ended badly, and their results.
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
        """Whether the step ended at an optimum, according to Ipopt or, without it, to the solver's tolerance."""
        return self.converged if self.certificate is None else self.certificate.confirmed


def data_record(recording: Recording, role: str) -> DataRecord:
    """Provenance of a recording."""
    source = recording.source
    return DataRecord(
        role, recording.name, source.path, source.sha256, source.columns,
        len(recording), len(recording.runs), recording.duration, source.between, source.where, source.column_map,
    )  # fmt: skip
