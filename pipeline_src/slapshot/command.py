"""Common command line of stages: `python -m slapshot.<stage> --recipe JSON` makes one version.

Snakemake calls it, and so does `slapshot stage NAME --config FILE`, which works out the recipes first.
"""

import argparse
import json
import logging
import os
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from slapshot.errors import InputError, writing
from slapshot.memory import keep_freed_memory
from slapshot.store.folder import Store
from slapshot.store.recipe import Recipe

M = TypeVar("M", bound=BaseModel)

log = logging.getLogger("slapshot")


@dataclass(frozen=True)
class Run:
    """Settings and folders of one run of a stage.

    Attributes:
        config: the recipe's settings as JSON values; `settings` reads them.
        inputs: role -> folder of an upstream version.
        out: folder to write the payload to.
        cores: number of cores to use; the content must not depend on it.
    """

    config: Mapping[str, Any]
    inputs: Mapping[str, Path]
    out: Path
    cores: int

    def settings(self, model: type[M]) -> M:
        """The stage's settings, as passed to `slapshot.dag.recipes.Plan.add`."""
        return model.model_validate_json(json.dumps(self.config))


def stage_command(stage: str, produce: Callable[[Run], None], resume: bool = False) -> None:
    """Parse the command line, make the version unless it exists, and exit.

    Args:
        stage: the stage's name.
        produce: writes the payload.
        resume: True if `produce` can continue from the files that an interrupted run left in `out`.
    """
    parser = argparse.ArgumentParser(prog=f"python -m slapshot ({stage})")
    parser.add_argument("--recipe", required=True, help="canonical JSON, as the workflow passes it")
    parser.add_argument("--store", type=Path, default=Path("data/store"))
    parser.add_argument("--cores", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--log", type=Path, help="file that gets a copy of all messages")
    parser.add_argument("--label", help="what the version is, for people")
    args = parser.parse_args()
    keep_freed_memory()
    store = Store(args.store)
    try:
        set_up_logging(args.label or stage, args.log)
        recipe = Recipe.from_json(args.recipe)
        make_version(store, recipe, produce, args.cores, resume, args.label or "")
    except InputError as error:
        log.debug("%s", traceback.format_exc())
        log.error("%s", error)
        sys.exit(1)
    except Exception as error:
        log.debug("%s", traceback.format_exc())
        where = f"; the traceback is in {args.log}" if args.log else ""
        log.error("%s: %s%s", type(error).__name__, " ".join(str(error).split()), where)
        if not args.log:
            traceback.print_exc()
        sys.exit(1)


def make_version(
    store: Store,
    recipe: Recipe,
    produce: Callable[[Run], None],
    cores: int,
    resume: bool = False,
    label: str = "",
) -> Path:
    """Make one version unless it exists, or wait for the process that makes it; return its folder."""
    name = recipe.stage, recipe.id
    folder = store.folder(*name)
    made = False
    with writing(folder):
        if not store.is_whole(*name):
            inputs = store.inputs(recipe)
            with store.locked(*name):
                if not store.is_whole(*name):  # another process may have made it in the meantime
                    with store.new_version(recipe, resume, label) as out:
                        produce(Run(config=recipe.config, inputs=inputs, out=out, cores=cores))
                    made = True
    log.info("%s %s", recipe.id, "made" if made else "is already whole")
    return folder


def set_up_logging(label: str, file: Path | None) -> None:
    """Log messages to the terminal, prefixed by `label`, and in full detail to `file`."""
    log.setLevel(logging.DEBUG)
    log.propagate = False  # libraries add handlers to the root logger, which would print everything twice
    console = logging.StreamHandler()
    console.setLevel(logging.INFO)
    console.setFormatter(logging.Formatter(f"[{label.replace('%', '%%')}] %(message)s"))
    log.addHandler(console)
    logging.raiseExceptions = False  # a full disk is reported once, not by a traceback per message
    if file is not None:
        with writing(file):
            file.parent.mkdir(parents=True, exist_ok=True)
            copy = logging.FileHandler(file, mode="w")
        copy.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        log.addHandler(copy)
