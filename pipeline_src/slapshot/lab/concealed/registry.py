"""All kinds of concealed physics by name."""

from collections.abc import Mapping

from slapshot.errors import InputError
from slapshot.lab.concealed import across, camera, contact, place, slide, swing
from slapshot.lab.concealed.kind import Kind

_ALL: tuple[Kind, ...] = (
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
    place.UnevenBoard(),
    place.PlaceFriction(),
    slide.LinearDrag(),
    slide.QuadraticDrag(),
    slide.StribeckFriction(),
    slide.TurnedAnisotropy(),
    slide.Curl(),
    slide.OffcentreMass(),
    place.AttractingSpot(),
    place.Tether(),
    place.PulsingFan(),
    across.FrictionDrift(),
    camera.CameraScale(),
    camera.CameraRotation(),
    camera.CameraTime(),
    camera.LensDistortion(),
)

KINDS: Mapping[str, Kind] = {kind.name: kind for kind in _ALL}


def kind_named(name: str) -> Kind:
    """A kind.

    Raises:
        InputError: there is none of that name.
    """
    if name not in KINDS:
        raise InputError(f"lab.concealed: no kind {name!r}; use one of: {', '.join(KINDS)}")
    return KINDS[name]
