"""Stage `figure`: draw one figure and write it with its table."""

from importlib import import_module

from slapshot.command import Run, stage_command
from slapshot.figures.drawing import FigureModule, save, use_style


def produce(run: Run) -> None:
    """Write <name>.png, <name>.pdf and <name>.csv."""
    use_style()
    module: FigureModule = import_module(run.config["module"])
    save(module.draw(run.inputs, run.config), run.out)


if __name__ == "__main__":
    stage_command("figure", produce)
