"""Result of `gb.fit` and `gb.load`: estimates as pandas objects, scores, simulations, profiles, figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from rich.console import RenderableType

from ..base.declared import understood
from ..base.errors import BadInput
from ..base.json_data import attributes
from ..base.numbers import between, pretty_unit
from ..datasets.recording import Recording
from ..fitting.fit import FREE_RUN, Fit
from ..fitting.uncertainty.profile import Profile
from ..reports.text.fit import as_dict, parts
from ..reports.text.screen import as_text
from . import given, predictions, profiles
from .estimates import NamedEstimates
from .given import Columns, Recordings
from .predictions import Validation, validation

if TYPE_CHECKING:
    import control

    from .plots import FitPlots

MOST_SHOWN = 6
"""Most parameters that a fit's `repr` shows."""


@dataclass(frozen=True, repr=False)
class FitResult(NamedEstimates):
    """A fit: the model at its estimates, their uncertainty, and predictions of recordings.

    `gb.fit` and `gb.load` return it. Attributes of the base class (`model`, `sd`, `stages`, `metrics`, `data` ...) are
    documented at `greybox_id.fitting.fit.Fit`.

    Attributes
    ----------
    recordings : training and validation recordings, in the order of `data`, if available.
    file : from which it was loaded; None if it was not.
    vehicle : name of the vehicle with the initial values, if it was not loaded; "" if there is none.
    warnings : sentences on possible mistakes in the input, if it was not loaded.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> fit = gb.fit("kinematic", lap, vehicle="roboracer")
    >>> fit.params.index.tolist()
    ['l_f', 'l_r', 'steer_gain', 'yaw_lag', 'K_us']
    >>> low, high = fit.conf_int(0.95).loc["yaw_lag"]
    >>> bool(low < fit.params["yaw_lag"] < high)
    True
    >>> fit.score(lap).columns.tolist()
    ['output', 'unit', 'protocol', 'horizon', 'rmse', 'stderr', 'fit_percent', 'fvu', 'samples']
    """

    vehicle: str = field(default="", compare=False)
    warnings: tuple[str, ...] = field(default=(), compare=False)

    @classmethod
    def of(
        cls,
        fit: Fit,
        recordings: tuple[Recording, ...] = (),
        file: Path | None = None,
        vehicle: str = "",
        warnings: tuple[str, ...] = (),
    ) -> FitResult:
        """Wrap a fit."""
        attributes_of_fit = {one.name: getattr(fit, one.name) for one in fields(Fit)}
        return cls(**attributes_of_fit, recordings=recordings, file=file, vehicle=vehicle, warnings=warnings)

    @property
    def nobs(self) -> int:
        """Number of readings of all outputs in the training residuals."""
        return sum(int(error["samples"]) for error in self._trained.values())

    @property
    def df_model(self) -> int:
        """Number of estimated scalars, including a standard deviation of the readings per output."""
        return sum(p.size for p in self.model.parameters if not p.fixed) + len(self._trained)

    @property
    def llf(self) -> float:
        """Log-likelihood of the training residuals (free run; models with memory one sample ahead), if normal and
        white.

        Residuals of a free run are correlated, so differences of `llf`, `aic` and `bic` between models are too large.
        Errors on held-out recordings decide between models (`compare`, `validate`).
        """
        errors = self._trained.values()
        return -0.5 * float(sum(each["samples"] * (np.log(2.0 * np.pi * each["rmse"] ** 2) + 1.0) for each in errors))

    @property
    def aic(self) -> float:
        """Akaike's information criterion, 2 `df_model` - 2 `llf`."""
        return float(2.0 * self.df_model - 2.0 * self.llf)

    @property
    def bic(self) -> float:
        """Bayesian information criterion, ln(`nobs`) `df_model` - 2 `llf`."""
        return float(np.log(self.nobs) * self.df_model - 2.0 * self.llf)

    @property
    def resid(self) -> pd.DataFrame:
        """Residuals of the free run on the training data, a column per output [SI], by recording and time [s].

        Raises
        ------
        BadInput : if a recording is missing or has changed, or was made in memory and is not available.
        """
        residuals = [predictions.residuals(self, recording) for recording in self.seen("train")]
        tables = [pd.DataFrame(dict(item.signals), index=pd.Index(item.time, name="time")) for item in residuals]
        return pd.concat(tables, keys=[item.name for item in self.data if item.role == "train"], names=["recording"])

    def compare(self, *others: Fit) -> pd.DataFrame:
        """Compare this fit with others of the same training data.

        Parameters
        ----------
        others : fits, as returned by `gb.fit` and `gb.load`.

        Returns
        -------
        pandas.DataFrame
            A row per fit, this one first: `model` with its effects, `df_model`, `aic`, `bic`, and per output the RMSE
            [SI] of the free run on the training data (`train yaw_rate`) and held-out data (`validate yaw_rate`).

        Raises
        ------
        BadInput : if a fit has other training data, for which criteria cannot be compared.
        """
        fits = [self, *(one if isinstance(one, FitResult) else FitResult.of(one) for one in others)]
        data = [
            {replace(record, path="", column_map="") for record in fit.data if record.role == "train"} for fit in fits
        ]
        for fit, training in zip(fits, data, strict=True):
            if training != data[0]:
                raise BadInput(
                    f"others: the fit of {fit.model.name} was made with other training data; fit both to the same "
                    "recordings, or compare them on one recording with score."
                )
        rows = [
            {
                "model": " + ".join((fit.model.name, *fit.model.effects)),
                **attributes(fit, "df_model", "aic", "bic"),
                **{f"train {name}": error["rmse"] for name, error in fit._trained.items()},
                **{f"validate {name}": error["rmse"] for name, error in fit._free_run("validate").items()},
            }
            for fit in fits
        ]
        return pd.DataFrame(rows)

    @property
    def _trained(self) -> Mapping[str, Any]:
        return self._free_run("train")

    def _free_run(self, role: str) -> Mapping[str, Any]:
        """Output -> errors of the free run on data of a role; for models with memory without it, one sample ahead."""
        protocols = self.metrics.get(role, {})
        named = next((name for name in (FREE_RUN, "closed_loop", "honest") if name in protocols), None)
        return {} if named is None else dict(protocols[named])

    def summary(self) -> str:
        """The text that `greybox fit` prints: verdict, data, optimum, parameters with intervals, held-out errors."""
        return as_text(self.parts())

    def parts(self) -> Iterator[RenderableType]:
        """The text that `greybox fit` prints, part by part."""
        return parts(self, self.vehicle)

    def to_json(self) -> dict[str, Any]:
        """The object that `greybox fit --json` prints."""
        return as_dict(self)

    def score(self, recording: Recording | str | Path, columns: Columns = "canonical") -> pd.DataFrame:
        """Errors on a recording, as from `gb.score`: a row per output and horizon."""
        return predictions.score(self, recording, columns)

    def validate(self, recordings: Recordings, columns: Columns = "canonical") -> Validation:
        """Whether the fit is usable on other recordings, compared with persistence and the model before the fit.

        Parameters
        ----------
        recordings : one or several, as recordings or files.
        columns : column map for files.

        Returns
        -------
        Validation
            `verdict` with its reasons, `scores`, `summary()`.

        Raises
        ------
        BadInput : if a signal is missing.
        """
        read = given.recordings(recordings, columns)
        names = [item.name for item in read]
        return validation(
            self, {name if names.count(name) == 1 else f"{name} ({k})": item for k, (name, item) in
                   enumerate(zip(names, read, strict=True), 1)},
        )  # fmt: skip

    def simulate(
        self,
        recording: Recording | str | Path,
        start: Mapping[str, float] | None = None,
        columns: Columns = "canonical",
    ) -> Recording:
        """The free run on a recording's inputs, as from `gb.simulate`."""
        return predictions.simulate(self, recording, start=start, columns=columns)

    def predict(
        self,
        recording: Recording | str | Path,
        horizon: float | None = None,
        columns: Columns = "canonical",
        calibrate: str | None = None,
    ) -> Recording:
        """Predictions over a horizon in seconds, as from `gb.predict`; `calibrate="timing"` likewise."""
        return predictions.predict(self, recording, horizon, calibrate=calibrate, columns=columns)

    def residuals(
        self, recording: Recording | str | Path, horizon: float | None = None, columns: Columns = "canonical"
    ) -> Recording:
        """Measured minus predicted per output, in SI units; NaN in rows without prediction or measurement.

        Parameters
        ----------
        recording : inputs and measurements.
        horizon : s ahead of the readings of every row; None for the free run.
        columns : column map for a file.
        """
        return predictions.residuals(self, recording, horizon, columns)

    def profile(self, parameter: str, confidence: float = 0.95) -> Profile:
        """Profile likelihood of a parameter, with all others re-optimised, as from `gb.profile`."""
        return profiles.profile(self, parameter, confidence=confidence)

    @understood
    def linearise(self, v_x: float, steer: float = 0.0) -> control.StateSpace:
        """The linear system around a steady turn, for poles, Bode plots and step responses with python-control.

        Parameters
        ----------
        v_x : speed, m/s, above zero.
        steer : road-wheel angle, rad; 0 is straight on.

        Returns
        -------
        control.StateSpace
            States, inputs and outputs have the model's names (`sys.state_labels` ...), in SI units, as deviations from
            the steady state. Actuators (lags) and relaxed quantities are states; pure delays are omitted with a
            warning.

        Raises
        ------
        BadInput : if the model is not one of equations of motion, or has no such steady state.

        Examples
        --------
        >>> import greybox_id as gb
        >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
        >>> fit = gb.fit("lateral", lap, vehicle="roboracer", free=[], options=gb.FitOptions(solver="gauss-newton"))
        >>> fit.linearise(v_x=3.0).state_labels
        ['v_y', 'yaw_rate']
        """
        from .linear import linearised  # control takes a second to load

        return linearised(self.model, v_x, steer)

    @property
    def plot(self) -> FitPlots:
        """Figures as matplotlib Axes: `plot()` measured and simulated; `plot.residuals()`, `plot.tyres()` and more."""
        from .plots import FitPlots  # matplotlib takes as long to load as a fit

        return FitPlots(self)

    def __repr__(self) -> str:
        return "\n".join(self._lines())

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(str(name))}</td><td>{between(row.estimate, row.lower, row.upper)}</td>"
            f"<td>{escape(pretty_unit(self.model[str(name)].unit))}</td></tr>"
            for name, row in self._shown().iterrows()
        )
        head = "<tr><th>parameter</th><th>estimate [95 % interval]</th><th>unit</th></tr>"
        first, *rest = self._lines(table=False)
        return f"<p><b>{escape(first)}</b><br>{'<br>'.join(map(escape, rest))}</p><table>{head}{rows}</table>"

    def _lines(self, table: bool = True) -> list[str]:
        names = ", ".join(item.name for item in self.data if item.role == "train")
        last = self.stages[-1] if self.stages else None
        lines = [
            f"Fit of {' + '.join((self.model.name, *self.model.effects))} to {names or 'nothing'}",
            f"  {last.status}, {last.steps} steps" if last is not None else "  imported",
        ]
        if table:
            shown = self._shown()
            for name, row in shown.iterrows():
                unit = pretty_unit(self.model[str(name)].unit)
                lines.append(f"  {name} = {between(row.estimate, row.lower, row.upper)} {unit}")
            more = self.model.size - sum(p.fixed for p in self.model.parameters) - len(shown)
            if more > 0:
                lines.append(f"  and {more} more: .summary(), .params, .conf_int()")
        return lines

    def _shown(self) -> pd.DataFrame:
        names = [p.name for p in self.model.parameters if p.shape == () and not p.fixed][:MOST_SHOWN]
        return pd.concat([self.params, self.conf_int()], axis=1).loc[names]
