"""All hidden effects by name."""

from collections.abc import Mapping

from slapshot.errors import InputError
from slapshot.lab.hidden_effects import camera, contact, position_time, slide, swing
from slapshot.lab.hidden_effects.hidden_effect import HiddenEffect

_ALL: tuple[HiddenEffect, ...] = (
    swing.CommandDelay(),
    swing.TrackingLag(),
    swing.ServoGain(),
    swing.JointElasticity(),
    swing.Backlash(),
    swing.CrookedArm(),
    contact.CompliantBlade(),
    contact.Restitution(),
    contact.BladeFriction(),
    contact.BladeYaw(),
    contact.CurvedBlade(),
    slide.Tilt(),
    position_time.UnevenBoard(),
    position_time.PlaceFriction(),
    slide.LinearDrag(),
    slide.QuadraticDrag(),
    slide.StribeckFriction(),
    slide.TurnedAnisotropy(),
    slide.Curl(),
    slide.OffcentreMass(),
    position_time.AttractingSpot(),
    position_time.Tether(),
    position_time.PulsingFan(),
    position_time.FrictionDrift(),
    camera.CameraScale(),
    camera.CameraRotation(),
    camera.CameraTime(),
    camera.LensDistortion(),
)

HIDDEN_EFFECTS: Mapping[str, HiddenEffect] = {effect.name: effect for effect in _ALL}


def hidden_effect_named(name: str) -> HiddenEffect:
    """A hidden effect.

    Raises:
        InputError: there is none of that name.
    """
    if name not in HIDDEN_EFFECTS:
        raise InputError(f"lab.concealed: no hidden effect {name!r}; use one of: {', '.join(HIDDEN_EFFECTS)}")
    return HIDDEN_EFFECTS[name]
