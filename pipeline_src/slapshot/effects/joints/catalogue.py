"""The catalogue of effects on joints and bodies: every file of this folder that defines one."""

from functools import cache
from importlib import import_module

from slapshot.effects.joints import joint_effect_modules
from slapshot.effects.joints.effect import JointEffect, RigMotion
from slapshot.errors import InputError
from slapshot.own_code import import_own

_registered: set[str] = set()


@cache
def _shipped() -> frozenset[str]:
    """Modules of this folder that define an effect."""
    return frozenset(import_module(name).__name__ for name in joint_effect_modules())


def joint_effects() -> dict[str, type[JointEffect]]:
    """Name -> effect, in alphabetical order."""
    modules = _shipped() | _registered
    found = {kind.name: kind for kind in _all(JointEffect) if kind.__module__ in modules}
    return dict(sorted(found.items()))


def import_joint_effects(module: str, where: str) -> None:
    """Register every effect that a user's module defines.

    Args:
        module: dotted name; it is announced before its code runs.
        where: file and key that name it.

    Raises:
        InputError: there is no such module, it cannot be imported, or it defines no effect.
    """
    taken = joint_effects()
    name = import_own(module, where).__name__
    own = [kind for kind in _all(JointEffect) if kind.__module__ == name and hasattr(kind, "name")]
    if not own:
        raise InputError(
            f"{where}: module {module} defines no JointEffect; derive one from "
            "effects.joints.effect.JointEffect"
        )
    for kind in own:
        if kind.name in taken and taken[kind.name] is not kind:
            raise InputError(f"{where}: module {module} defines {kind.name!r} anew; give it another name")
    _registered.add(name)


def instances(rig: RigMotion) -> list[JointEffect]:
    """All effects on all parts of a rig."""
    return [effect for kind in joint_effects().values() for effect in kind.instances(rig)]


def _all(kind: type[JointEffect]) -> list[type[JointEffect]]:
    return [k for sub in kind.__subclasses__() for k in (sub, *_all(sub))]
