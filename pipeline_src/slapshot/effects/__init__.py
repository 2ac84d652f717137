"""Effects: the catalogue of physics that a nominal scene may lack, one file each.

To add one is to add a file here, or to name a module of one's own in the configuration
(`diagnosis.effects`); `catalogue` finds both.
"""

from pkgutil import iter_modules

_MACHINERY = ("effect", "bases", "catalogue", "slide_law")
_ONLY_TOLD = ("__main__", "table")  # no result depends on them


def effect_modules() -> list[str]:
    """Dotted names of the modules of this package that define an effect; none is imported."""
    return [name for name in modules_of_results() if name.rpartition(".")[2] not in _MACHINERY]


def modules_of_results() -> list[str]:
    """The same with what effects are built from: all that a diagnosis depends on here."""
    names = sorted(info.name for info in iter_modules(__path__))
    return [f"{__name__}.{name}" for name in names if name not in _ONLY_TOLD]
