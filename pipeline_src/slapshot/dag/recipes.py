"""The set of recipes that a configuration asks for."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from slapshot.dag.stages import STAGES
from slapshot.errors import InputError
from slapshot.store.recipe import Recipe, file_digest, make_recipe
from slapshot.validation import Model, values_of


@dataclass
class Plan:
    """Recipes by label; a label says stage, domain and what else tells instances apart.

    Attributes:
        recipes: label -> recipe, upstream first. Equal recipes under two labels are one version.
        on_demand: labels of what `snakemake figures` does not make.
    """

    recipes: dict[str, Recipe] = field(default_factory=dict)
    on_demand: set[str] = field(default_factory=set)
    _bare: dict[tuple[str, ...], Recipe] = field(default_factory=dict, repr=False)  # by stage and modules

    def add(
        self,
        label: str,
        stage: str,
        settings: Model | None,
        upstream: Mapping[str, str] | None = None,
        modules: Iterable[str] = (),
        files: Mapping[str, Path] | None = None,
        on_demand: bool = False,
    ) -> None:
        """Add one recipe.

        Args:
            label: says stage, domain and what else tells instances apart.
            stage: its name.
            settings: what it is told, which `Run.settings` gives it back; None for nothing.
            upstream: role -> label of an earlier recipe.
            modules: that it imports by name.
            files: name -> file from outside the store.
            on_demand: `snakemake figures` does not make it.
        """
        if on_demand or STAGES[stage].on_demand:
            self.on_demand.add(label)
        above = {role: self.recipes[up] for role, up in (upstream or {}).items()}
        self.recipes[label] = replace(
            self._bare_recipe(stage, tuple(modules)),
            config={} if settings is None else values_of(settings),
            upstream={role: (recipe.stage, recipe.id) for role, recipe in above.items()},
            files={name: file_digest(path) for name, path in (files or {}).items()},
        )

    def _bare_recipe(self, stage: str, modules: tuple[str, ...]) -> Recipe:
        """Stage, code and libraries alone: code is read once for the hundreds of cases of a proof."""
        key = (stage, *modules)
        if key not in self._bare:
            self._bare[key] = make_recipe(stage, [STAGES[stage].module, *modules], {}, {})
        return self._bare[key]

    def of_stage(self, stage: str) -> dict[str, Recipe]:
        """Label -> recipe of one stage."""
        return {label: r for label, r in self.recipes.items() if r.stage == stage}

    def of_figures(self) -> dict[str, Recipe]:
        """Label -> recipe of all that `snakemake figures` makes."""
        return {label: r for label, r in self.recipes.items() if label not in self.on_demand}

    def names_of(self, stage: str) -> list[str]:
        """What tells the versions of a stage apart, such as hockey-F7."""
        return [label.removeprefix(f"{stage}/").replace("/", "-") for label in self.of_stage(stage)]

    def by_id(self, stage: str, version_id: str) -> Recipe:
        """The recipe with that id.

        Raises:
            InputError: the configuration asks for no such version.
        """
        for recipe in self.of_stage(stage).values():
            if recipe.id == version_id:
                return recipe
        raise InputError(
            f"the configuration asks for no version {stage}/{version_id}; "
            f"see `slapshot versions why {stage}` for what it asks for"
        )

    def ids(self) -> dict[str, set[str]]:
        """Stage -> ids."""
        return {stage: {r.id for r in self.of_stage(stage).values()} for stage in STAGES}


def in_words(label: str) -> str:
    """A label as people read it: `train hockey/kalman`."""
    return label.replace("/", " ", 1)
