"""Cases of real recordings of a vehicle that was changed, with all from before beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from greybox_id.base.files import write_atomically
from greybox_id.datasets.recording import Recording
from greybox_id.datasets.shipped import named_text
from greybox_id.models.vehicle import ChosenModel, vehicle, write_vehicle

from .answers import Answer, write_answer
from .folder import AFTER, BEFORE, CASES, COLUMNS, SEALED
from .make import write_recording


@dataclass(frozen=True)
class ChangedCase:
    """What changed between recordings of a real vehicle, as a case.

    Attributes
    ----------
    vehicle, model : shipped vehicle, and model in place of its own; "" for its own.
    before : recordings in which nothing had changed.
    after : the recording that is diagnosed, and a second one that decides; or none.
    answer : kept back.
    """

    vehicle: str
    model: str
    before: Sequence[Recording]
    after: Sequence[Recording]
    answer: Answer

    def written(self, folder: Path) -> Answer:
        """Write it into an examination."""
        given, (first, *more) = folder / CASES / self.answer.case, self.after
        value, (canonical, _) = vehicle(self.vehicle), named_text("canonical", "columns", "column map")
        write_vehicle(replace(value, model=ChosenModel(self.model)) if self.model else value, given / "vehicle.toml")
        write_atomically(given / COLUMNS, canonical.replace('hold = "zero"', f'hold = "{first.hold}"'))
        write_recording(first, given / "recording.csv")
        for one in more:
            write_recording(one, given / AFTER)
        for k, one in enumerate(self.before, 1):
            write_recording(one, given / BEFORE.replace("*", str(k)))
        write_answer(self.answer, folder / SEALED / self.answer.case / "answer.json")
        return self.answer


def shuffled(count: int, seed: int) -> list[str]:
    """Names of cases that tell nothing of the order in which they are planned."""
    digits = max(3, len(str(count)))
    return [f"case_{place:0{digits}d}" for place in np.random.default_rng((seed, 61031)).permutation(count)]


def lacking(data: Path, files: Sequence[str]) -> list[str]:
    """Those of the files that are not there."""
    return [name for name in dict.fromkeys(files) if not (data / name).is_file()]
