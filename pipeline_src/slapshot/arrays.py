"""The type of numeric arrays, and the gravitational acceleration."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY = 9.81  # m/s^2
