"""Copy the results of one version to a folder of figures/, with a list of the versions upstream."""

import argparse
import json
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from slapshot.blind_validation.case_table import merge_measures
from slapshot.command import set_up_logging
from slapshot.errors import InputError, writing
from slapshot.publish import copy_file
from slapshot.store.version_file import REPAIR, damaged_files, read_version_file

log = logging.getLogger("slapshot")

TOLD = (".csv", ".md", ".png", ".pdf")


def publish_version(
    version: Path, target: Path, folder: str, beside: Sequence[str] = (), measures: str | None = None
) -> None:
    """Copy tables, pages and figures of a version to `target`/`folder`, and versions.json.

    Args:
        version: folder of the version.
        target: figures/, or that of a configuration.
        folder: name of the folder in `target`.
        beside: files that are copied to `target` itself.
        measures: table of a blind validation that is merged into `target`; rows of other labs are kept.

    Raises:
        InputError: the version is damaged, or `target` cannot be written.
    """
    damaged = damaged_files(version)
    if damaged:
        raise InputError(f"{version / damaged[0]} is not what was written there; {REPAIR}")
    with writing(target):
        aside = target / folder
        aside.mkdir(parents=True, exist_ok=True)
        for file in sorted(version.iterdir()):
            if file.name == measures:
                merge_measures(file, target / file.name)
            elif file.suffix in TOLD:
                copy_file(file, (target if file.name in beside else aside) / file.name)
        recipe = read_version_file(version)["recipe"]
        own = {recipe["stage"]: version.name}
        made_from = own | {role: pair[1] for role, pair in recipe["upstream"].items()}
        text = json.dumps(made_from, indent=1, sort_keys=True) + "\n"
        (aside / ".versions.json").write_text(text)
        (aside / ".versions.json").rename(aside / "versions.json")
    log.info("%s told in %s", version.name, aside)


def main() -> None:
    """Command line that the workflow calls."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.publish_version")
    parser.add_argument("version", type=Path, help="folder of a version")
    parser.add_argument("--name", required=True, help="of the configuration")
    parser.add_argument("--folder", required=True, help="in figures/, or in that of the configuration")
    parser.add_argument("--beside", action="append", default=[], help="file that goes beside the folder")
    parser.add_argument("--measures", help="table of a proof that goes there, beside the rows of other labs")
    parser.add_argument("--log", type=Path)
    args = parser.parse_args()
    target = Path("figures") if args.name == "default" else Path("figures") / args.name
    try:
        set_up_logging("publish", args.log)
        publish_version(args.version, target, args.folder, args.beside, args.measures)
    except (InputError, OSError) as error:
        log.error("%s", error)
        sys.exit(1)


if __name__ == "__main__":
    main()
