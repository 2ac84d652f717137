"""The set of recipes of a configuration."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from slapshot.dag.stages import STAGES
from slapshot.errors import InputError
from slapshot.store.recipe import Recipe, file_digest, make_recipe
from slapshot.validation import Model, values_of


@dataclass
class Plan:
    """Recipes by label, which consists of stage, domain and further identifiers of an instance.

    Attributes:
        recipes: label -> recipe, in topological order. Equal recipes under two labels are one version.
        on_demand: labels of the recipes that `snakemake figures` does not make.
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
            label: stage, domain and further identifiers, separated by slashes.
            stage: name of the stage.
            settings: of the stage, which reads them by `Run.settings`; None for none.
            upstream: role -> label of an earlier recipe.
            modules: that the stage imports dynamically, by name.
            files: name -> file from outside the store.
            on_demand: True if `snakemake figures` does not make it.
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
        """Stage, code and libraries only, cached: a validation has hundreds of cases with the same code."""
        key = (stage, *modules)
        if key not in self._bare:
            self._bare[key] = make_recipe(stage, [STAGES[stage].module, *modules], {}, {})
        return self._bare[key]

    def of_stage(self, stage: str) -> dict[str, Recipe]:
        """Label -> recipe of one stage."""
        return {label: r for label, r in self.recipes.items() if r.stage == stage}

    def of_figures(self) -> dict[str, Recipe]:
        """Label -> recipe of everything that `snakemake figures` makes."""
        return {label: r for label, r in self.recipes.items() if label not in self.on_demand}

    def chain_lengths(self) -> dict[str, int]:
        """Stage -> number of versions in the longest chain that begins with one of it; 0 for none."""
        names = {(recipe.stage, recipe.id): label for label, recipe in self.recipes.items()}
        after = dict.fromkeys(self.recipes, 0)  # longest chain that depends on it
        lengths = dict.fromkeys(STAGES, 0)
        for recipe in reversed(self.recipes.values()):
            length = after[names[recipe.stage, recipe.id]] + 1
            lengths[recipe.stage] = max(lengths[recipe.stage], length)
            for above in recipe.upstream.values():
                after[names[above]] = max(after[names[above]], length)
        return lengths

    def names_of(self, stage: str) -> list[str]:
        """Labels of a stage without the stage's name, such as hockey-F7."""
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
    """A label for people, such as `train hockey/kalman`."""
    return label.replace("/", " ", 1)
