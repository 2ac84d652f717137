"""Copy what a proof says to figures/, with the versions that it was made from."""

import argparse
import json
import logging
import shutil
import sys
from pathlib import Path

from slapshot.command import set_up_logging
from slapshot.errors import InputError, writing

log = logging.getLogger("slapshot")

TOLD = ("proof.csv", "proof.md")  # stand in figures/ itself, the rest in figures/proof/


def publish(version: Path, target: Path) -> None:
    """Copy a version of stage `score`: proof.csv and proof.md to `target`, the rest to `target`/proof."""
    with writing(target):
        folder = target / "proof"
        folder.mkdir(parents=True, exist_ok=True)
        for file in sorted(version.iterdir()):
            if file.suffix in {".csv", ".md", ".png", ".pdf"}:
                _copy(file, (target if file.name in TOLD else folder) / file.name)
        recipe = json.loads((version / "version.json").read_text())["recipe"]
        made_from = {"score": version.name} | {role: pair[1] for role, pair in recipe["upstream"].items()}
        aside = folder / ".versions.json"
        aside.write_text(json.dumps(made_from, indent=1, sort_keys=True) + "\n")
        aside.rename(folder / "versions.json")
    log.info("%s told in %s", version.name, target / "proof.md")


def _copy(file: Path, target: Path) -> None:
    aside = target.with_name(f".{target.name}")
    shutil.copyfile(file, aside)
    aside.rename(target)


def main() -> None:
    """Command line, as the workflow calls it."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.proof.publish")
    parser.add_argument("version", type=Path, help="folder of a version of stage `score`")
    parser.add_argument("--name", required=True, help="of the configuration")
    parser.add_argument("--log", type=Path)
    args = parser.parse_args()
    target = Path("figures") if args.name == "default" else Path("figures") / args.name
    try:
        set_up_logging("proof", args.log)
        publish(args.version, target)
    except (InputError, OSError) as error:
        log.error("%s", error)
        sys.exit(1)


if __name__ == "__main__":
    main()
