"""A recording parted where so many seconds of motion are over."""

from __future__ import annotations

import numpy as np

from ..errors import BadInput
from ..recording import Recording
from ..scores.timing import moving


def parted(recording: Recording, seconds: float) -> tuple[Recording, Recording | None]:
    """The rows until so many seconds of motion are over, and the rest; None where nothing is left.

    Raises
    ------
    BadInput : the recording holds less motion than that.
    """
    recording.must_run()
    count = np.cumsum(moving(recording))
    needed = seconds / recording.sample_time
    if count[-1] < np.floor(needed * (1 - 1e-9)):
        raise BadInput(
            f"{recording.name} holds {count[-1] * recording.sample_time:.3g} s of motion, but {seconds:g} s were asked "
            "for (‹seconds›). Record more, or ask for less."
        )
    cut = int(np.searchsorted(count, np.ceil(needed * (1 - 1e-9)))) + 1
    first = recording.rows(0, cut)
    return first, recording.rows(cut, len(recording)) if cut < len(recording) else None
