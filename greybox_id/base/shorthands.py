"""Types that many files name."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Say = Callable[[str], None]
"""Told, line by line, what is going on; `fitting.how.Say` tells lines that pass from lines that stay."""
