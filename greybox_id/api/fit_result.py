"""A fit as `gb.fit` and `gb.load` return it: numbers by name as pandas, scores, simulations, profiles, figures."""

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
"""Parameters that a fit's `repr` shows."""


@dataclass(frozen=True, repr=False)
class FitResult(NamedEstimates):
    """A fit: the model at its estimates, how well each is known, and what the model makes of recordings.

    `gb.fit` and `gb.load` return it. What it is as a record (`model`, `sd`, `stages`, `metrics`, `data` ...) is
    documented at `greybox_id.fitting.fit.Fit`.

    Attributes
    ----------
    recordings : those that it was fitted to and validated on, in the order of `data`, where they are at hand.
    file : where it was loaded from; None where it was not.
    vehicle : name of the vehicle whose numbers it started from, where it was fitted just now; "" where there is none.
    warnings : sentences on what may not be meant, where it was fitted just now.

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
        """A fit with what it can do."""
        value = {one.name: getattr(fit, one.name) for one in fields(Fit)}
        return cls(**value, recordings=recordings, file=file, vehicle=vehicle, warnings=warnings)

    @property
    def nobs(self) -> int:
        """Readings of all outputs that the training residuals are of."""
        return sum(int(error["samples"]) for error in self._trained.values())

    @property
    def df_model(self) -> int:
        """Single numbers that were estimated, a standard deviation of the readings of each output among them."""
        return sum(p.size for p in self.model.parameters if not p.fixed) + len(self._trained)

    @property
    def llf(self) -> float:
        """Log-likelihood of the training residuals (free run; maps with memory one sample ahead), normal and white.

        Residuals of a free run are correlated: between models, `llf`, `aic` and `bic` differ by more than they should.
        What decides is the error on recordings that were held out (`compare`, `validate`).
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
        """Residuals of the free run on the training data, a column an output [SI], by recording and time [s].

        Raises
        ------
        BadInput : a recording is no longer there or has changed, or was made in memory and is not at hand.
        """
        left = [predictions.residuals(self, recording) for recording in self.seen("train")]
        tables = [pd.DataFrame(dict(item.signals), index=pd.Index(item.time, name="time")) for item in left]
        return pd.concat(tables, keys=[item.name for item in self.data if item.role == "train"], names=["recording"])

    def compare(self, *others: Fit) -> pd.DataFrame:
        """This fit beside others of the same training data.

        Parameters
        ----------
        others : fits, as `gb.fit` and `gb.load` return them.

        Returns
        -------
        pandas.DataFrame
            A row per fit, this one first: `model` with its effects, `df_model`, `aic`, `bic`, and per output the RMSE
            [SI] of the free run on the training data (`train yaw_rate`) and on what was held out (`validate yaw_rate`).

        Raises
        ------
        BadInput : a fit was made with other training data, of which no criterion compares models.
        """
        fits = [self, *(one if isinstance(one, FitResult) else FitResult.of(one) for one in others)]
        data = [
            {replace(record, path="", column_map="") for record in fit.data if record.role == "train"} for fit in fits
        ]
        for fit, seen in zip(fits, data, strict=True):
            if seen != data[0]:
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
        """Output -> errors of the free run on the data of a role; of maps with memory, one sample ahead."""
        protocols = self.metrics.get(role, {})
        named = next((name for name in (FREE_RUN, "closed_loop", "honest") if name in protocols), None)
        return {} if named is None else dict(protocols[named])

    def summary(self) -> str:
        """What `greybox fit` prints: verdict, data, optimum, parameters with intervals, errors on what was held out."""
        return as_text(self.parts())

    def parts(self) -> Iterator[RenderableType]:
        """What `greybox fit` prints, part by part."""
        return parts(self, self.vehicle)

    def to_json(self) -> dict[str, Any]:
        """What `greybox fit --json` prints of it."""
        return as_dict(self)

    def score(self, recording: Recording | str | Path, columns: Columns = "canonical") -> pd.DataFrame:
        """Errors on a recording, as `gb.score` gives them: a row per output and horizon."""
        return predictions.score(self, recording, columns)

    def validate(self, recordings: Recordings, columns: Columns = "canonical") -> Validation:
        """Whether the fit is usable on other recordings, beside persistence and the model before it was fitted.

        Parameters
        ----------
        recordings : one or several, read or named by files.
        columns : column map, where files are named.

        Returns
        -------
        Validation
            `verdict` with its reasons, `scores`, `summary()`.

        Raises
        ------
        BadInput : a signal is missing.
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
        """The free run on a recording's inputs, as `gb.simulate` gives it."""
        return predictions.simulate(self, recording, start=start, columns=columns)

    def predict(
        self,
        recording: Recording | str | Path,
        horizon: float | None = None,
        columns: Columns = "canonical",
        calibrate: str | None = None,
    ) -> Recording:
        """Predictions so many seconds ahead, as `gb.predict` gives them; `calibrate="timing"` as there."""
        return predictions.predict(self, recording, horizon, calibrate=calibrate, columns=columns)

    def residuals(
        self, recording: Recording | str | Path, horizon: float | None = None, columns: Columns = "canonical"
    ) -> Recording:
        """Measured less predicted, output by output, in SI units; NaN in rows that are not predicted or not measured.

        Parameters
        ----------
        recording : inputs and readings.
        horizon : s ahead of the readings of every row; None for the free run.
        columns : column map, where a file is named.
        """
        return predictions.residuals(self, recording, horizon, columns)

    def profile(self, parameter: str, confidence: float = 0.95) -> Profile:
        """Profile likelihood of a parameter, all others re-optimised, as `gb.profile` gives it."""
        return profiles.profile(self, parameter, confidence=confidence)

    @understood
    def linearise(self, v_x: float, steer: float = 0.0) -> control.StateSpace:
        """The linear system about a steady turn, for poles, Bode plots and step responses with python-control.

        Parameters
        ----------
        v_x : speed, m/s, above zero.
        steer : road-wheel angle, rad; 0 is straight on.

        Returns
        -------
        control.StateSpace
            States, inputs and outputs carry the model's names (`sys.state_labels` ...), in SI units, as deviations from
            the steady state. Actuators (lags) and relaxed quantities are states; pure delays are not in it, and a
            warning says so.

        Raises
        ------
        BadInput : the model is none of equations of motion, or has no steady state there.

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
