"""`python -m slapshot.blind_validation.redraw`: a published proof, drawn anew from its cases.csv alone.

Needs neither the store nor the verdicts, as after a change of how a proof is shown. Verdicts and scores stay
those of the run that made cases.csv.
"""

import argparse
import sys
from pathlib import Path
from typing import Literal

from slapshot.blind_validation.cases import read_cases
from slapshot.blind_validation.page import publish_proof
from slapshot.config.cases import ProofSettings
from slapshot.config.files import load_config
from slapshot.errors import InputError, writing


def redraw(folder: Path, pages: Path, which: Literal["full", "small"]) -> None:
    """Draw a published proof anew; commands and lab are those of the default configuration.

    Args:
        folder: with cases.csv, such as figures/proof.
        pages: for proof.csv and proof.md, such as figures.
        which: full or small.

    Raises:
        InputError: the table is missing or lacks a column, or a folder cannot be written.
    """
    config = load_config()
    shown = ProofSettings(list=which, pool=config.cases.pool, lab=config.lab_of_cases)
    lists = {"full": config.cases.published, "small": config.cases.small}
    with writing(folder):
        publish_proof(folder, pages, shown, listed=len(read_cases(Path(lists[which]))))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.blind_validation.redraw", description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("figures/proof"), help="with cases.csv")
    parser.add_argument("--pages", type=Path, default=Path("figures"), help="for proof.csv and proof.md")
    parser.add_argument("--list", choices=("full", "small"), default="full")
    args = parser.parse_args()
    try:
        redraw(args.folder, args.pages, args.list)
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
