"""Cases of real recordings of a vehicle that was changed, with recordings from before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from greybox_id.base.files import write_atomically
from greybox_id.datasets.recording import Recording
from greybox_id.models.vehicle import ChosenModel, vehicle, write_vehicle

from .answers import Answer, write_answer
from .folder import AFTER, BEFORE, CASES, COLUMNS, SEALED, columns_text
from .make import write_recording


@dataclass(frozen=True)
class ChangedCase:
    """A change between recordings of a real vehicle, as a case.

    Attributes
    ----------
    vehicle, model : shipped vehicle, and model instead of its own; "" for its own.
    before : recordings from before the change.
    after : the recording that is diagnosed, and optionally a second one for verification.
    answer : withheld.
    """

    vehicle: str
    model: str
    before: Sequence[Recording]
    after: Sequence[Recording]
    answer: Answer

    def written(self, folder: Path) -> Answer:
        """Write the case into an examination."""
        given, (first, *more) = folder / CASES / self.answer.case, self.after
        value = vehicle(self.vehicle)
        write_vehicle(replace(value, model=ChosenModel(self.model)) if self.model else value, given / "vehicle.toml")
        write_atomically(given / COLUMNS, columns_text(first.hold))
        write_recording(first, given / "recording.csv")
        for one in more:
            write_recording(one, given / AFTER)
        for k, one in enumerate(self.before, 1):
            write_recording(one, given / BEFORE.replace("*", str(k)))
        write_answer(self.answer, folder / SEALED / self.answer.case / "answer.json")
        return self.answer


def shuffled(count: int, seed: int) -> list[str]:
    """Names of cases in random order, so that they do not reveal the plan."""
    digits = max(3, len(str(count)))
    return [f"case_{place:0{digits}d}" for place in np.random.default_rng((seed, 61031)).permutation(count)]


def lacking(data: Path, files: Sequence[str]) -> list[str]:
    """The files that are missing."""
    return [name for name in dict.fromkeys(files) if not (data / name).is_file()]
