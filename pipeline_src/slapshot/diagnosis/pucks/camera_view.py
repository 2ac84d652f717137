"""What effects of the camera make of launches and of where objects lay."""

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.slide_model import Values
from slapshot.effects.effect import Effect

SHORT = 1e-3  # s
DECELERATION = 3.5  # m/s^2, typical of dry friction


def camera_shift(effect: Effect, values: Values, launches: Array, camera: Array) -> Array:
    """(n, 5) seen less true launch: a place, and another a moment later."""
    each = {name: np.full(len(launches), value) for name, value in values.items()}
    place, velocity = launches[:, :2], launches[:, 2:4]
    delay = effect.camera_delay(each)
    moment = np.zeros(len(place)) if delay is None else -delay
    speed = np.maximum(np.linalg.norm(velocity, axis=1), 1e-6)
    # What slows the object is nearly the same under all hypotheses.
    slowed = velocity * (1 - DECELERATION * moment / speed)[:, None]
    places = np.stack([place, place + SHORT * velocity], axis=1) + moment[:, None, None] * velocity[:, None]
    seen = effect.see(each, places, camera)
    shift = np.zeros_like(launches)
    shift[:, :2] = seen[:, 0] - place
    shift[:, 2:4] = (seen[:, 1] - seen[:, 0]) / SHORT - velocity + (slowed - velocity)
    return shift


def start_shift(effect: Effect, values: Values, starts: Array, camera: Array) -> Array:
    """(n, 2) m by which objects really lay elsewhere than a camera saw them, at `starts` (n, 2)."""
    if not effect.acts_on_camera:
        return np.zeros_like(starts)
    each = {name: np.full(len(starts), value) for name, value in values.items()}
    return starts - effect.see(each, starts[:, None], camera)[:, 0]
