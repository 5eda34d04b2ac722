"""Types of arrays and tuples for annotations. This module does not import numba, which takes 0.4 s."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

Vector = tuple[float, float, float]
"""In compiled code a tuple, because a small array is allocated on the heap each time."""
Quaternion = tuple[float, float, float, float]
"""w, x, y, z; a tuple for the same reason."""
