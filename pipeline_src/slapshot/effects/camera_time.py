"""Camera time: the camera's clock is late against the arm's."""

from collections.abc import Mapping

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter


class CameraTime(Effect):
    name = "camera_time"
    phase = "camera"
    follows = "time"
    parameters = (Parameter("delay", "s", -0.2, 0.2, 0.01, "the camera reports late"),)
    physics = (
        "Exposure, transfer and buffering delay the time stamp of a frame against that of the command.\n"
        "The object seems to start late; how it then moves does not change."
    )
    source = "Furgale, Rehder and Siegwart 2013, Unified temporal and spatial calibration (IROS)"
    known_to = 0.0

    def camera_delay(self, values: Mapping[str, Array]) -> Array:
        """The same for all frames."""
        return values["delay"]
