"""The catalogue: every effect there is. A file in this folder adds its own; `register` adds one's own."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from importlib import import_module
from types import ModuleType
from typing import Annotated, Any, get_args

from pydantic import Field, model_validator

from slapshot.effects import effect_modules
from slapshot.effects.effect import Effect, Follows, Parameter, Phase
from slapshot.errors import InputError
from slapshot.own_code import code_of, import_own
from slapshot.validation import NAME, Model, validated

_registered: dict[str, Effect] = {}

OF_DIAGNOSIS = "free_"  # names of diagnosis.pucks.selection.free_form begin so
Text = Annotated[str, Field(min_length=1)]


class ParameterFacts(Model):
    """What a parameter must say of itself."""

    name: Annotated[str, Field(pattern=NAME)]
    unit: Text
    low: float
    high: float
    scale: Annotated[float, Field(gt=0)]
    meaning: Text
    neutral: float

    @model_validator(mode="after")
    def _within_bounds(self) -> "ParameterFacts":
        if not self.low < self.high:
            raise ValueError(f"low {self.low:g} is not below high {self.high:g}; correct them")
        if not self.low <= self.neutral <= self.high:
            raise ValueError(
                f"neutral {self.neutral:g} is not within {self.low:g} to {self.high:g}; correct it"
            )
        if self.scale > self.high - self.low:
            raise ValueError(f"scale {self.scale:g} is more than high less low; write a plain case")
        return self


class EffectFacts(Model):
    """What an effect must say of itself."""

    name: Annotated[str, Field(pattern=NAME)]
    phase: Phase
    follows: Follows
    parameters: Annotated[tuple[ParameterFacts, ...], Field(min_length=1)]
    physics: Text
    source: Text

    @model_validator(mode="after")
    def _names_are_free(self) -> "EffectFacts":
        if self.name.startswith(OF_DIAGNOSIS):
            raise ValueError(
                f"names that begin with {OF_DIAGNOSIS} are taken by the diagnosis; rename {self.name!r}"
            )
        names = [parameter.name for parameter in self.parameters]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two parameters are called {name!r}; rename one of them")
        return self


def catalogue() -> Mapping[str, Effect]:
    """Name -> effect, in the order of phases and names: those of this package and those registered."""
    for module in effect_modules():
        for kind in _effects_of(import_module(module)):
            register(kind())
    phases = get_args(Phase)
    order = sorted(_registered, key=lambda name: (phases.index(_registered[name].phase), name))
    return {name: _registered[name] for name in order}


def register(effect: Effect, where: str = "effects") -> None:
    """Add an effect to the catalogue; the same one again changes nothing.

    Args:
        effect: with a name of its own.
        where: file and key that name its module.

    Raises:
        InputError: another effect has its name.
    """
    known = _registered.setdefault(effect.name, effect)
    if type(known) is not type(effect):
        raise InputError(
            f"{where}: two effects are called {effect.name!r} ({type(known).__module__} and "
            f"{type(effect).__module__}); rename one of them"
        )


def import_effects(*modules: str, where: str = "effects") -> None:
    """Register every effect that modules of one's own define.

    Args:
        modules: dotted names; each is announced before its code runs.
        where: file and key that name them.

    Raises:
        InputError: there is no such module, it cannot be imported, or it defines no effect that can be.
    """
    catalogue()  # whose names are taken
    for name in modules:
        found = _effects_of(import_own(name, where))
        if not found:
            raise InputError(
                f"{where}: module {name} defines no Effect; derive one from effects.effect.Effect"
            )
        for kind in found:
            with code_of(name, where):
                effect = kind()
                facts = _facts_of(effect)
            validated(EffectFacts, facts, f"{where}: {name}.{kind.__name__}")
            register(effect, where)


def _effects_of(module: ModuleType) -> list[type[Effect]]:
    return [
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Effect) and value.__module__ == module.__name__
    ]


def _facts_of(effect: Effect) -> dict[str, Any]:
    """What an effect says of itself, as plain values."""
    facts = {key: getattr(effect, key) for key in EffectFacts.model_fields if hasattr(effect, key)}
    parameters = facts.get("parameters")
    if isinstance(parameters, tuple | list):
        facts["parameters"] = [asdict(p) if isinstance(p, Parameter) else p for p in parameters]
    return facts


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
