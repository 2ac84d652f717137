"""The catalogue of effects on joints and bodies: every file of this folder that defines one."""

from functools import cache
from importlib import import_module
from pathlib import Path

from slapshot.effects.joints.effect import JointEffect, Situation

_OTHERS = {"__init__", "catalogue", "effect", "parts", "split"}


@cache
def joint_effects() -> dict[str, type[JointEffect]]:
    """Name -> effect, in alphabetical order."""
    for file in sorted(Path(__file__).parent.glob("*.py")):
        if file.stem not in _OTHERS:
            import_module(f"{__package__}.{file.stem}")
    found: dict[str, type[JointEffect]] = {}
    for kind in _all(JointEffect):
        if hasattr(kind, "name") and kind.__module__.startswith(f"{__package__}."):
            found[kind.name] = kind
    return dict(sorted(found.items()))


def instances(rig: Situation) -> list[JointEffect]:
    """All effects on all parts of a rig."""
    return [effect for kind in joint_effects().values() for effect in kind.instances(rig)]


def _all(kind: type[JointEffect]) -> list[type[JointEffect]]:
    return [k for sub in kind.__subclasses__() for k in (sub, *_all(sub))]
