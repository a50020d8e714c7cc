"""Types that many files name."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Say = Callable[[str], None]
"""Called with each line about progress; `fitting.how.Say` distinguishes passing lines from lasting ones."""
