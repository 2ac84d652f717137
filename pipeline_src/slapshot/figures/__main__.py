"""Stage `figure`: draw one figure and write it with its table."""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from slapshot.command import Run, stage_command
from slapshot.plotting import Drawing, save, use_style


class FigureModule(Protocol):
    """A module of this package that draws one figure."""

    def draw(self, inputs: Mapping[str, Path], config: Mapping[str, Any]) -> Drawing:
        """Draw from upstream version folders (role -> folder) and the configuration."""


def produce(run: Run) -> None:
    """Write <name>.png, <name>.pdf and <name>.csv."""
    use_style()
    module: FigureModule = import_module(run.config["module"])
    save(module.draw(run.inputs, run.config), run.out)


if __name__ == "__main__":
    stage_command("figure", produce)
