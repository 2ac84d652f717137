"""`python -m slapshot.proof.lists FILE`: draw a list of cases under new seeds of the operating system."""

import argparse
import sys
from pathlib import Path

from slapshot.errors import InputError, writing
from slapshot.proof.cases import write_cases
from slapshot.proof.conditions import LISTS, draw_list


def draw_file(which: str, file: Path) -> None:
    """Draw a list into a file that does not exist yet.

    Raises:
        InputError: the file exists, or cannot be written.
    """
    if file.exists():
        raise InputError(f"{file}: exists already; seeds are drawn once, so name another file or remove it")
    with writing(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        aside = file.with_name(f".{file.name}")
        write_cases(draw_list(LISTS[which], which[0]), aside)
        aside.rename(file)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.proof.lists")
    parser.add_argument("file", type=Path)
    parser.add_argument("--list", choices=LISTS, default="full")
    args = parser.parse_args()
    try:
        draw_file(args.list, args.file)
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
