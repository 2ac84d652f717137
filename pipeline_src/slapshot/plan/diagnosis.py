"""Recipes of diagnoses of the recordings that the configuration names."""

from collections.abc import Mapping
from importlib.util import find_spec
from pkgutil import iter_modules
from typing import Any

from slapshot.plan.recipes import Plan
from slapshot.plan.sources import Sources
from slapshot.scenes.randomisation import middle_condition

SEED = 0
_EFFECTS = "slapshot.effects"
_ONLY_TOLD = ("__main__", "table")  # of that package: no result depends on them


def effect_modules() -> list[str]:
    """Modules of the catalogue, which finds them by itself; without importing them."""
    spec = find_spec(_EFFECTS)
    assert spec is not None
    names = sorted(info.name for info in iter_modules(spec.submodule_search_locations))
    return [f"{_EFFECTS}.{name}" for name in names if name not in _ONLY_TOLD]


def what_is_believed(domain: Mapping[str, Any]) -> dict[str, Any]:
    """What a diagnosis is told beside the scene: the friction, and no effects of one's own."""
    condition = middle_condition(domain["randomisation"])
    return {"friction": [condition[f"friction_{axis}"] for axis in ("x", "y", "torsional")], "effects": []}


def add_diagnoses(plan: Plan, name: str, domain: Mapping[str, Any]) -> None:
    """The report of every recording; of stand-in rigs, of the first one."""
    for recording, settings in domain["recordings"].items():
        first = {**settings, "rigs": 1} if "lab" in settings else settings
        sources = Sources.of(name, {"recordings": {recording: first}}, [recording])
        plan.add(
            f"diagnosis/{name}/{recording}",
            "diagnosis",
            {"seed": SEED, "recordings": sources.described, **what_is_believed(domain)},
            {"scene": f"scene/{name}", **sources.roles},
            modules=effect_modules(),
            files=sources.files,
        )
