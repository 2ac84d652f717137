"""All hidden effects on joints, by name."""

from collections.abc import Mapping

from slapshot.errors import InputError
from slapshot.lab.joints.hidden_effect import HiddenEffect
from slapshot.lab.joints.hidden_effects import base, drive, encoder, friction, structure, surroundings

_ALL: tuple[HiddenEffect, ...] = (
    friction.ViscousFriction(),
    friction.CoulombFriction(),
    friction.StribeckFriction(),
    friction.LoadFriction(),
    friction.DirectionFriction(),
    friction.FrictionDrift(),
    structure.JointElasticity(),
    structure.Backlash(),
    structure.Armature(),
    structure.LinkMass(),
    structure.Payload(),
    structure.JointOffset(),
    structure.Spring(),
    base.GravityTilt(),
    base.BaseCompliance(),
    drive.ActuatorGain(),
    drive.ActuatorLag(),
    drive.CommandDelay(),
    drive.Saturation(),
    drive.TorqueRipple(),
    encoder.EncoderScale(),
    encoder.EncoderDelay(),
    surroundings.ExternalPulse(),
    surroundings.SlackCable(),
    surroundings.Magnet(),
    surroundings.SoftObstacle(),
    base.SlippingBase(),
    drive.Foldback(),
    encoder.StickySensor(),
)

HIDDEN_EFFECTS: Mapping[str, HiddenEffect] = {effect.name: effect for effect in _ALL}


def hidden_effect_named(name: str) -> HiddenEffect:
    """A hidden effect.

    Raises:
        InputError: there is none of that name.
    """
    if name not in HIDDEN_EFFECTS:
        raise InputError(
            f"lab: no hidden effect {name!r} for joints; use one of: {', '.join(HIDDEN_EFFECTS)}"
        )
    return HIDDEN_EFFECTS[name]
