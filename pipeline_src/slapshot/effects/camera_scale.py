"""Camera scale: a metre in the recording is not a metre."""

from collections.abc import Mapping

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter


class CameraScale(Effect):
    name = "camera_scale"
    phase = "camera"
    follows = "place"
    parameters = (Parameter("log_scale", "1", -0.3, 0.3, 0.02, "log of reported over true length"),)
    physics = (
        "A wrong focal length or height of the camera: places are stretched about the point it looks at.\n"
        "Speeds and distances grow alike, so that only what is known otherwise (start, commands) tells it."
    )
    source = "Hartley and Zisserman, Multiple View Geometry, section 6.1"

    def see(self, values: Mapping[str, Array], places: Array, camera: Array) -> Array:
        """Stretched about the camera's foot."""
        return places + values["log_scale"][:, None, None] * (places - camera)
