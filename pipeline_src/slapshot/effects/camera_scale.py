"""Camera scale: a metre in the recording is not a metre."""

from collections.abc import Mapping

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.camera_shift import SHIFT, shifted
from slapshot.effects.effect import Effect, Parameter


class CameraScale(Effect):
    name = "camera_scale"
    phase = "camera"
    follows = "place"
    parameters = (
        Parameter("log_scale", "1", -0.3, 0.3, 0.02, "log of reported over true length"),
        *SHIFT,
    )
    physics = (
        "A wrong focal length or height of the camera: places are stretched about some point, and shifted.\n"
        "Speeds and distances grow alike, so that only what is known otherwise (start, commands) tells it."
    )
    source = "Hartley and Zisserman, Multiple View Geometry, section 6.1"
    known_to = 0.0

    def see(self, values: Mapping[str, Array], places: Array, camera: Array) -> Array:
        """Stretched about the camera's foot, and shifted."""
        return shifted(values, places + np.expm1(values["log_scale"])[:, None, None] * (places - camera))
