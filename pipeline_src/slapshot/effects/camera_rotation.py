"""Camera rotation: the recording's axes are turned."""

from collections.abc import Mapping

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.camera_shift import SHIFT, shifted
from slapshot.effects.effect import Effect, Parameter


class CameraRotation(Effect):
    name = "camera_rotation"
    phase = "camera"
    follows = "place"
    parameters = (Parameter("angle", "rad", -0.5, 0.5, 0.02, "anticlockwise, of what is reported"), *SHIFT)
    physics = (
        "The camera is mounted askew: places are turned about some point, and shifted.\n"
        "All headings turn by one angle, and places far from that point shift most."
    )
    source = "Hartley and Zisserman, Multiple View Geometry, section 2.4"
    known_to = 0.0

    def see(self, values: Mapping[str, Array], places: Array, camera: Array) -> Array:
        """Turned about the camera's foot, and shifted."""
        cosine = np.cos(values["angle"])[:, None]
        sine = np.sin(values["angle"])[:, None]
        x, y = places[..., 0] - camera[0], places[..., 1] - camera[1]
        turned = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
        return shifted(values, camera + turned)
