"""What a diagnosis must name for what the joint lab conceals.

Every catalogued kind of the lab has one effect, which bears its name. On some rigs another effect is exactly
the same law, so that no recording can tell the two apart: these are aliases. Nothing that is merely alike is
one, nor is a more general law of which the concealed one is a special case of measure zero.
"""

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

_KEY = re.compile(r"(?P<name>[^@ ]+)(?:@(?P<part>.*?))?(?: \(.*\))?(?: from order \S+)?$")
_OF_WHOLE_RIG = {"gravity_tilt", "base_compliance"}  # their effects sit on no part


class Named(NamedTuple):
    """An effect at a part of the rig; "" for the whole rig."""

    effect: str
    part: str


# Rig and concealed effect -> the one that is the same law there. tests/proof/joints holds both against each
# other by inverse dynamics.
ALIASES: Mapping[tuple[str, Named], Named] = {
    # All axes of this rig are level and parallel: turning the first link's zero turns all links against
    # gravity alike, as turning gravity about that axis does, and inertia does not depend on the first angle.
    ("pendulum", Named("joint_offset", "joint1")): Named("gravity_tilt", ""),
    # The first axis is upright and its link turns about it alone: gravity does no work, and whatever the link
    # weighs adds a constant to the inertia about that axis, as a rotor does.
    ("arm", Named("armature", "joint1")): Named("link_mass", "turret"),
    ("kuka", Named("armature", "q0")): Named("link_mass", "link1"),
    ("kuka", Named("link_mass", "link1")): Named("armature", "q0"),
}


def right_names(rig: str, concealed: Mapping[str, Any]) -> tuple[Named, ...]:
    """Effects that are right for a piece of concealed physics: its own first, then an alias.

    Args:
        rig: name of the stand-in rig.
        concealed: an entry of `concealed` in the truth.
    """
    kind = concealed["kind"]
    place = "" if kind in _OF_WHOLE_RIG else concealed["joint"] or concealed["body"]
    own = Named(kind, place)
    alias = ALIASES.get((rig, own))
    return (own,) if alias is None else (own, alias)


def named_of(key: str) -> Named:
    """Effect and part of an effect's key, `name@part (variant)`."""
    found = _KEY.match(key)
    assert found is not None, f"{key!r} is no key of an effect"
    return Named(found["name"], found["part"] or "")
