"""Marks: files whose existence tells Snakemake that a version exists.

With version folders as outputs, Snakemake would delete them, and create incomplete ones. A mark is named
after the label and the id of its version, such as `train/hockey-kalman-0123456789ab`, which dry runs, graphs
and logs show.
"""

import re
from pathlib import Path

from slapshot.dag.recipes import Plan, in_words
from slapshot.errors import writing
from slapshot.store.folder import Store
from slapshot.store.recipe import ID_LENGTH, Recipe

_LONGEST = 100  # characters of a name, of the 255 bytes that a file may have


class Marks:
    """The marks of the versions of a plan.

    Args:
        root: folder of marks, usually data/marks.
        plan: whose labels name the marks; for equal recipes, the first label is used.
    """

    def __init__(self, root: Path, plan: Plan) -> None:
        self._root, self._plan = root, plan
        self._labels: dict[tuple[str, str], str] = {}
        for label, recipe in plan.recipes.items():
            self._labels.setdefault((recipe.stage, recipe.id), label)

    def of(self, recipe: Recipe) -> Path:
        """The mark of a version of the plan."""
        return self._of(recipe.stage, recipe.id)

    def above(self, recipe: Recipe) -> list[Path]:
        """Marks of the versions upstream of a recipe."""
        return [self._of(*version) for version in recipe.upstream.values()]

    def pattern(self, stage: str) -> Path:
        """Path pattern of a stage's marks, with the wildcard `version`."""
        return self._root / stage / "{version}"

    def recipe(self, stage: str, version: str) -> Recipe:
        """Recipe of a value of the wildcard of `pattern`.

        Raises:
            InputError: the configuration asks for no such version.
        """
        return self._plan.by_id(stage, version[-ID_LENGTH:])

    def label(self, recipe: Recipe) -> str:
        """The version's label for people, such as `train hockey/kalman`."""
        return in_words(self._labels[recipe.stage, recipe.id])

    def refresh(self, store: Store) -> None:
        """Synchronise marks with the store, since versions are also made and removed without Snakemake.

        Raises:
            InputError: a mark cannot be made or removed.
        """
        for stage, version_id in self._labels:
            mark = self._of(stage, version_id)
            # The mark is checked first: another process completes a version before it makes the mark.
            if mark.exists():
                if not store.is_whole(stage, version_id):
                    with writing(mark):
                        mark.unlink(missing_ok=True)
            elif store.is_whole(stage, version_id):
                with writing(mark):
                    mark.parent.mkdir(parents=True, exist_ok=True)
                    mark.touch()
        for mark in self._root.glob("*/*"):
            version = mark.parent.name, mark.name[-ID_LENGTH:]
            if version not in self._labels and not store.folder(*version).is_dir():
                with writing(mark):
                    mark.unlink(missing_ok=True)

    def _of(self, stage: str, version_id: str) -> Path:
        name = re.sub(r"[^\w.]+", "-", self._labels[stage, version_id].partition("/")[2], flags=re.ASCII)
        return self._root / stage / f"{name[:_LONGEST]}-{version_id}".lstrip("-")
