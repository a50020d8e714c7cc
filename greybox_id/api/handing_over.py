"""Handing results on: code for a controller, reports for people."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from ..base.declared import understood
from ..base.errors import BadInput
from ..base.files import at_once
from ..base.guard import claim
from ..base.json_data import format_of
from ..base.numbers import pretty_unit
from ..datasets.recording import Recording
from ..export.subject import KeyOrigin, Subject
from ..export.verb import ALONE, ForeignResult, cautions, exporter_of, exporter_of_file, origins
from ..export.verb import export as export_subject
from ..fitting.fit import Fit
from ..fitting.posterior.posterior import Posterior, load_posterior
from ..fitting.requested_model import Magnitudes, RequestedModel, magnitudes, with_choices
from ..gap.gap import Gap
from ..models.effect import Effect
from ..models.model import Model
from ..models.registry import known, with_effects
from ..reports.comparison import NamedFit, comparison
from ..reports.document import Document, Part, Section, write_drawings
from ..reports.gap.report import gap_report
from ..reports.gap.saved import load_gap
from ..reports.recordings import matched
from ..reports.report import kind_of, prepared, write
from ..reports.text.screen import plain
from ..reports.track.digest import Digest, load_track
from ..reports.track.report import track_report
from . import given
from .fit_result import FitResult
from .fitting import load as load_fit
from .gap_result import GapResult
from .given import Columns, Effects, ModelLike, Numbers, Recordings, VehicleLike
from .track_result import TrackResult

Result = Fit | Gap | TrackResult | Digest


class Exported(list[Path]):
    """The files of an export.

    Attributes
    ----------
    target, name : what they are for, and what functions in them are called after.
    model : name of the model, or what the result is called.
    cautions : sentences on what the files do not hold, or take for granted.
    keys : for files of parameters, what is behind each key.
    """

    target: str
    name: str
    model: str
    cautions: tuple[str, ...]
    keys: tuple[KeyOrigin, ...]

    def __init__(
        self, files: Iterable[Path], target: str, name: str, model: str, cautions: Iterable[str] = (),
        keys: Iterable[KeyOrigin] = (),
    ) -> None:  # fmt: skip
        super().__init__(files)
        self.target, self.name, self.model = target, name, model
        self.cautions, self.keys = tuple(cautions), tuple(keys)

    def to_json(self) -> dict[str, Any]:
        """What `greybox export --json` prints."""
        keys, written = [key.plain() for key in self.keys], [str(file) for file in self]
        return {"target": self.target, "name": self.name, "model": self.model, "written": written, "keys": keys}


@understood
def export(
    model: ModelLike | Fit | Path | Any,
    to: str | Path,
    *,
    target: str = "c",
    name: str = "",
    parameters: str | Iterable[str] = "free",
    vehicle: VehicleLike = None,
    effects: Effects = (),
    fix: str | Iterable[str] | Numbers = (),
    source: str = "",
    command: str = "",
) -> Exported:
    """Write a model for a controller or a simulator elsewhere.

    Parameters
    ----------
    model : a fit, a model such as `gap.closed_model`, a model's name, or a policy or its file, which "c" and
        "onnx" take.
    to : folder, which appears whole or not at all; an earlier export there is replaced, other files are not. A
        functional mock-up unit may be named by itself, "car.fmu".
    target : "c", "casadi", "acados", "onnx", "f1tenth", "fmu", "simulink", "autoware", "ros2", "opendbc" or "tir".
    name : what functions are called after; by default the folder's name.
    parameters : which can be changed afterwards, others become constants: "free", "all", or a list of names.
    vehicle : whose numbers a model that is named has.
    effects, fix : effects that are added to it, and parameters that are held, at numbers of one's own.
    source, command : of the manifest: where the numbers are from, and what reproduces the export.

    Returns
    -------
    Exported
        A list of the files written, a manifest among them, with `cautions` and `keys`.

    Raises
    ------
    BadInput : there is no such target, the model cannot be written for it, or the folder holds other files.

    Examples
    --------
    >>> import tempfile
    >>> import greybox_id as gb
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = gb.export(gb.models.lateral(vehicle="roboracer"), f"{folder}/car")
    >>> "car.c" in [file.name for file in files]
    True
    """
    if not isinstance(to, str | Path):
        raise BadInput(f"to: the path of a folder is needed, not {to!r:.60}.")
    name = name or identifier(to)
    if isinstance(model, Path) or (isinstance(model, str) and model.endswith(".json")):
        exporter, source = exporter_of_file(model), source or str(model)
        model = load_fit(model) if exporter is None else exporter.load(model)
    if not isinstance(model, Fit | Model | str | RequestedModel):
        exporter = exporter_of(model)
        files = exporter.write(model, ForeignResult(name, source, command), target, to)
        return Exported(files, target, name, exporter.what)
    fit, stated = model if isinstance(model, Fit) else None, given.vehicle(vehicle)
    if isinstance(model, RequestedModel):
        added, stated = dict(model.effects), model.vehicle
    else:
        objects, written = given.named_effects(effects)
        added = magnitudes(written)
        model = given.added(with_effects(given.model(model, stated), added), objects)
    exported = with_choices(given.model(model), given.choices(fix))
    where = source or (exported.name if fit is None else "fit")
    subject = Subject(exported, name, moving(exported, parameters), fit, where, command, stated)
    known = (*_assumed(exported, added), *cautions(subject, target))
    return Exported(export_subject(subject, target, to), target, name, exported.name, known, origins(subject, target))


def _assumed(model: Model, stated: Magnitudes) -> list[str]:
    """Sentences on effects that stand at a magnitude nobody stated."""
    return [
        f"{name} is taken at {plain(float(model[name].array))} {pretty_unit(model[name].unit)}, its typical size; "
        f"state it as {name}=VALUE."
        for name, magnitude in stated.items()
        if magnitude is None
    ]


@understood
def report(
    results: Result | str | Path | Sequence[Result | str | Path],
    out: str | Path,
    *,
    recordings: Recordings | None = None,
    columns: Columns | None = None,
    effects: Iterable[Effect] = (),
    posterior: Posterior | str | Path | None = None,
) -> Path:
    """Write what fits, diagnoses and tracks say as a report with figures, PDF or HTML.

    Parameters
    ----------
    results : a fit, a gap or a track, or the file of one; several fits are set side by side, other lists one after the
        other.
    out : file to write, .pdf or .html, atomically.
    recordings : those that the fits have seen, where they do not know them: those that `gb.fit` returned do, and loaded
        ones read them again from where they were.
    columns : column map, where files are named; of recordings that fits read again the one they name unless given.
    effects : of one's own that a diagnosis has tried.
    posterior : of a single fit of equations of motion, draws of `gb.sample` or their file: their table, a corner plot
        and bands of predictions.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    BadInput : a recording is missing or is another file, or `out` cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer")
    >>> fit = gb.fit("kinematic", lap, vehicle="roboracer")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.report(fit, f"{folder}/lap.html").name
    'lap.html'
    """
    if not isinstance(out, str | Path):
        raise BadInput(f"out: the path of a file is needed, not {out!r:.60}.")
    return reported(
        results, out, recordings=recordings, columns=columns, effects=effects, posterior=posterior
    ).file  # fmt: skip


@dataclass(frozen=True)
class Report:
    """A report that was written.

    Attributes
    ----------
    file : the report.
    figures : those that were written beside it.
    verdict : its first sentences.
    """

    file: Path
    figures: tuple[Path, ...]
    verdict: tuple[str, ...]


def reported(
    results: Result | str | Path | Sequence[Result | str | Path],
    out: str | Path,
    kind: str | None = None,
    *,
    recordings: Recordings | None = None,
    columns: Columns | None = None,
    effects: Iterable[Effect] = (),
    posterior: Posterior | str | Path | None = None,
    moved: Mapping[str, Sequence[str | Path]] | None = None,
    figures: str | Path | None = None,
) -> Report:
    """Write a report. Other arguments and errors are those of `report`.

    Parameters
    ----------
    kind : "pdf" or "html"; as the name of `out` says unless given.
    moved : role -> where the recordings of fits lie now, as of `FitResult.seen`.
    figures : folder that the figures are written to as well, as SVG.
    """
    kind = kind_of(out, kind)
    claim(out, becomes="a report")
    listed: Sequence[object] = results if isinstance(results, list | tuple) else [results]
    opening = [opened(item) if isinstance(item, str | Path) else item for item in listed]
    several = [item for item in opening if isinstance(item, Result)]
    if not several or len(several) < len(opening):
        other = next((type(item).__name__ for item in opening if not isinstance(item, Result)), "an empty list")
        raise BadInput(f"results: a Fit, a Gap, a Track or a list of them is needed, not {other}.")
    fits = [item for item in several if isinstance(item, Fit)]
    if posterior is not None and len(fits) + len(several) != 2:
        raise BadInput("‹posterior› belongs to one fit; name that fit alone.")
    seen = partial(_seen, recordings=recordings, columns=columns, moved=moved)
    with known(*(model for result in several if (model := _model_of(result)) is not None), *effects):
        if len(fits) == len(several) > 1:
            documents = [comparison([NamedFit(name, fit, seen(fit)) for name, fit in _names(fits).items()])]
        elif posterior is not None:
            draws = posterior if isinstance(posterior, Posterior) else load_posterior(posterior)
            documents = [prepared(fits[0], seen(fits[0]), draws)]
        else:
            documents = [_document(item, seen) for item in several]
        document = documents[0] if len(documents) == 1 else _one_after_the_other(documents)
        with at_once():
            file = write(document, out, kind)
            drawn = write_drawings(document.drawings, figures) if figures else []
    return Report(file, tuple(drawn), tuple(sentence for _, sentence in document.verdict))


def opened(file: str | Path) -> Result:
    """The fit, the gap or the track that a file holds. Raises `BadInput` where it holds none."""
    kind = format_of(Path(file))
    if kind == "greybox-gap":
        return GapResult.of(*load_gap(file))
    return load_track(file) if kind == "greybox-track" else load_fit(file)


def beside(files: Sequence[str | Path], kind: str) -> Path:
    """Where the report of some files is written unless a place is named: beside the first."""
    first = Path(files[0])
    return first.with_suffix(f".{kind}") if len(files) == 1 else first.with_name(f"comparison.{kind}")


def _names(fits: Sequence[Fit]) -> dict[str, Fit]:
    """Short names that differ: of the fits' files where that suffices, with their folders otherwise."""
    files = [fit.file for fit in fits if isinstance(fit, FitResult) and fit.file is not None]
    if len(files) < len(fits):
        return {f"{k} {fit.model.name}": fit for k, fit in enumerate(fits, 1)}
    if len({file.resolve() for file in files}) < len(files):
        raise BadInput(f"{', '.join(map(str, files))}: one fit is named twice; name each once.")
    for parts in (1, 2, None):
        names = [str(file) if parts is None else "/".join(file.with_suffix("").parts[-parts:]) for file in files]
        if len(set(names)) == len(names):
            break
    return dict(zip(names, fits, strict=True))


def identifier(folder: str | Path) -> str:
    """A folder's name as far as it can name functions of C; of a file that is written alone, without its ending."""
    value = Path(folder).resolve()
    name = value.stem if value.suffix in ALONE.values() else value.name
    result = re.sub(r"\W+", "_", name.lower(), flags=re.ASCII).strip("_")
    if not result:
        raise BadInput(f"The folder's name {folder} cannot name functions; name them with ‹name›.")
    return result if result[0].isalpha() else f"model_{result}"


def moving(model: Model, text: str | Iterable[str]) -> tuple[str, ...] | None:
    """Names of the parameters that can be changed after an export: "free", "all" (None), or a list of names."""
    if text == "all":
        return None
    if text == "free":
        return tuple(p.name for p in model.parameters if not p.fixed)
    names = text.split(",") if isinstance(text, str) else text
    return tuple(name.strip() for name in given.listed(names, "parameters") if name.strip())


def _model_of(result: Result) -> Model | None:
    return result.closed if isinstance(result, Gap) else None if isinstance(result, Digest) else result.model


def _document(result: Result, seen: Callable[[Fit], tuple[Recording, ...]]) -> Document:
    if isinstance(result, Fit):
        return prepared(result, seen(result))
    if isinstance(result, TrackResult | Digest):
        return track_report(result if isinstance(result, Digest) else result.digest)
    if not isinstance(result, GapResult):
        raise BadInput("This diagnosis does not know what it was made with; make it with gb.diagnose.")
    return gap_report(result, result.made)


def _seen(
    fit: Fit,
    recordings: Recordings | None,
    columns: Columns | None,
    moved: Mapping[str, Sequence[str | Path]] | None,
) -> tuple[Recording, ...]:
    if recordings is not None:
        return matched(fit, given.recordings(recordings, columns or "canonical"))
    if isinstance(fit, FitResult):
        return fit.seen(moved=moved, columns=columns, otherwise="Name the file's new place with ‹{role}›.")
    raise BadInput("recordings: hand over those that the fit has seen.")


def _one_after_the_other(documents: Sequence[Document]) -> Document:
    """One report of several."""
    parts: list[Part] = []
    for document in documents:
        parts += [Section(f"{document.title}: {document.of}"), *document.parts]
    first = documents[0]
    titles = ", ".join(dict.fromkeys(document.title for document in documents))
    return replace(
        first,
        title=titles,
        about="; ".join(document.about for document in documents),
        of="several results",
        parts=tuple(parts),
    )
