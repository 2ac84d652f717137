"""Effects that a model of joints and bodies may lack: one file for each effect."""

from pkgutil import iter_modules

_MACHINERY = ("catalogue", "effect", "parts", "split")


def joint_effect_modules() -> list[str]:
    """Dotted names of the modules of this package that define an effect; none is imported."""
    names = sorted(info.name for info in iter_modules(__path__))
    return [f"{__name__}.{name}" for name in names if name not in _MACHINERY]
