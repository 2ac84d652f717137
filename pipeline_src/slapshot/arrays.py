"""The type of arrays of numbers, and the constant of nature that several packages need."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY = 9.81  # m/s^2
