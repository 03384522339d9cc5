"""Types of arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


IntArray = NDArray[np.int64]

#: No number that is read from a file is larger: the differences and squares of these are finite.
LARGEST = 1e100
