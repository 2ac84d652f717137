"""Stage `figure`: draw one figure and write it with its table."""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Protocol

from slapshot.command import Run, stage_command
from slapshot.config.results import AnyFigureSettings, FigureSettings
from slapshot.plotting import Drawing, save, use_style


class FigureModule(Protocol):
    """A module of this package that draws one figure.

    One that shows more of the configuration than the domain's name says so by a class `Settings`.
    """

    def draw(self, inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
        """Draw from upstream version folders (role -> folder) and what is shown of the configuration."""


def produce(run: Run) -> None:
    """Write <name>.png, <name>.pdf and <name>.csv."""
    use_style()
    module: FigureModule = import_module(run.settings(AnyFigureSettings).module)
    settings = run.settings(getattr(module, "Settings", FigureSettings))
    save(module.draw(run.inputs, settings), run.out)


if __name__ == "__main__":
    stage_command("figure", produce)
