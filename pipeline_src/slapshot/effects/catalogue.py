"""The catalogue: every effect there is. A file in this folder adds its own; `register` adds one's own."""

from collections.abc import Iterable, Mapping
from importlib import import_module

from slapshot.effects import effect_modules
from slapshot.effects.effect import Effect
from slapshot.errors import InputError

_registered: dict[str, Effect] = {}


def catalogue() -> Mapping[str, Effect]:
    """Name -> effect, in the order of phases and names: those of this package and those registered."""
    import_effects(*effect_modules())
    phases = ("swing", "contact", "slide", "across hits", "camera")
    order = sorted(_registered, key=lambda name: (phases.index(_registered[name].phase), name))
    return {name: _registered[name] for name in order}


def register(effect: Effect) -> None:
    """Add an effect to the catalogue; the same one again changes nothing.

    Raises:
        InputError: another effect has its name.
    """
    known = _registered.setdefault(effect.name, effect)
    if type(known) is not type(effect):
        raise InputError(
            f"effects: two effects are called {effect.name!r} ({type(known).__module__} and "
            f"{type(effect).__module__}); rename one of them"
        )


def import_effects(*modules: str) -> None:
    """Register every effect that the modules define.

    Raises:
        InputError: there is no such module, or it defines no effect.
    """
    for name in modules:
        try:
            module = import_module(name)
        except ModuleNotFoundError:
            raise InputError(
                f"effects: no module {name}; use the dotted name of one that can be imported"
            ) from None
        found = [
            value
            for value in vars(module).values()
            if isinstance(value, type) and issubclass(value, Effect) and value.__module__ == module.__name__
        ]
        if not found:
            raise InputError(
                f"effects: module {name} defines no Effect; derive one from effects.effect.Effect"
            )
        for effect in found:
            register(effect())


def named(names: Iterable[str]) -> list[Effect]:
    """Effects by name.

    Raises:
        InputError: the catalogue has no such effect.
    """
    known = catalogue()
    missing = [name for name in names if name not in known]
    if missing:
        raise InputError(f"effects: no effect {missing[0]!r}; use one of: {', '.join(known)}")
    return [known[name] for name in names]
