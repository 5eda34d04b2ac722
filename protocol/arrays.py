"""Types of arrays and tuples, for annotations: free of numba, which takes a process 0.4 s to import."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""Both within compiled code: an array would be taken from the heap each time."""
