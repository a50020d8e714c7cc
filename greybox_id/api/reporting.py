"""Reports of results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..base.declared import understood
from ..base.errors import BadInput
from ..base.files import at_once
from ..base.guard import claim
from ..base.json_data import format_of
from ..datasets.recording import Recording
from ..fitting.fit import Fit
from ..fitting.posterior.posterior import Posterior, load_posterior
from ..models.effect import Effect
from ..models.model import Model
from ..models.registry import known
from ..reports.document import Document, Part, Section, write_drawings
from ..reports.recordings import matched
from ..reports.report import kind_of, prepared, write
from . import given
from .fit_result import FitResult
from .fitting import load as load_fit
from .given import Columns, Recordings

if TYPE_CHECKING:
    from .other_results import Other

    Result = Fit | Other


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
    """Write a report of fits, diagnoses and tracks with figures, as PDF or HTML.

    Parameters
    ----------
    results : a fit, a gap or a track, or the file of one; several fits are compared, other lists are reported one after
        the other.
    out : file to write, .pdf or .html, atomically.
    recordings : of the fits, if these do not have them: fits from `gb.fit` do, and loaded ones read them again from
        their files.
    columns : column map for files; for recordings that fits read again, by default that of the fit.
    effects : your own that a diagnosis has tried.
    posterior : of a single fit of equations of motion, draws from `gb.sample` or their file: adds a table, a corner
        plot and bands of predictions.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    BadInput : if a recording is missing or is another file, or `out` cannot be written.

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
    """A written report.

    Attributes
    ----------
    file : of the report.
    figures : separate files of figures.
    verdict : the first sentences of the report.
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
    """Write a report. Other parameters and errors are those of `report`.

    Parameters
    ----------
    kind : "pdf" or "html"; by default from the suffix of `out`.
    moved : role -> new paths of the recordings of fits, as in `FitResult.seen`.
    figures : folder for the figures as separate SVG files.
    """
    kind = kind_of(out, kind)
    claim(out, becomes="a report")
    listed: Sequence[object] = results if isinstance(results, list | tuple) else [results]
    opening = [opened(item) if isinstance(item, str | Path) else item for item in listed]
    fits = [item for item in opening if isinstance(item, Fit)]
    several = [*fits] if len(fits) == len(opening) > 0 else _results(opening)
    if posterior is not None and len(fits) + len(several) != 2:
        raise BadInput("‹posterior› is the posterior of one fit; name only that fit.")
    seen = partial(_seen, recordings=recordings, columns=columns, moved=moved)
    with known(*(model for result in several if (model := _model_of(result)) is not None), *effects):
        if len(fits) == len(several) > 1:
            from ..reports.comparison import NamedFit, comparison  # needed only for several fits

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
    """The fit, gap or track in a file. Raises `BadInput` if it contains none."""
    kind = format_of(Path(file))
    if kind not in ("greybox-gap", "greybox-track"):
        return load_fit(file)
    from .other_results import opened as other

    return other(file, kind)


def beside(files: Sequence[str | Path], kind: str) -> Path:
    """Default path of the report of some files: next to the first of them."""
    first = Path(files[0])
    return first.with_suffix(f".{kind}") if len(files) == 1 else first.with_name(f"comparison.{kind}")


def _names(fits: Sequence[Fit]) -> dict[str, Fit]:
    """Unique short names: those of the fits' files if sufficient, or with their folders."""
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


def _results(opening: Sequence[object]) -> list[Result]:
    """The arguments, if all of them are results. Raises `BadInput` if one is not."""
    from .other_results import Other  # loads the diagnosis and the filters

    several = [item for item in opening if isinstance(item, Fit | Other)]
    if not several or len(several) < len(opening):
        other = next((type(item).__name__ for item in opening if not isinstance(item, Fit | Other)), "an empty list")
        raise BadInput(f"results: a Fit, a Gap, a Track or a list of them is needed, not {other}.")
    return several


def _model_of(result: Result) -> Model | None:
    if isinstance(result, Fit):
        return result.model
    from .other_results import model_of

    return model_of(result)


def _document(result: Result, seen: Callable[[Fit], tuple[Recording, ...]]) -> Document:
    if isinstance(result, Fit):
        return prepared(result, seen(result))
    from .other_results import document

    return document(result)


def _seen(
    fit: Fit,
    recordings: Recordings | None,
    columns: Columns | None,
    moved: Mapping[str, Sequence[str | Path]] | None,
) -> tuple[Recording, ...]:
    if recordings is not None:
        return matched(fit, given.recordings(recordings, columns or "canonical"))
    if isinstance(fit, FitResult):
        return fit.seen(moved=moved, columns=columns, otherwise="Name the file's new path with ‹{role}›.")
    raise BadInput("recordings: pass the recordings that the fit was made with.")


def _one_after_the_other(documents: Sequence[Document]) -> Document:
    """Several reports combined into one."""
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
