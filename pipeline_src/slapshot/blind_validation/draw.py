"""Measures, page and figures of the proof, from its scored cases alone: for the stage and for a redraw."""

from pathlib import Path

import pandas as pd

from slapshot.blind_validation.case_table import FIRST, read_cases_table, write_measures
from slapshot.blind_validation.figures import draw_all
from slapshot.blind_validation.measures import measures_of
from slapshot.blind_validation.page import write_page
from slapshot.config.cases import ProofSettings
from slapshot.plotting import save


def draw_proof(folder: Path, pages: Path, settings: ProofSettings) -> None:
    """Write proof.csv, proof.md and P1 to P3 from cases.csv.

    Args:
        folder: with cases.csv; gets the figures.
        pages: gets proof.csv and proof.md.
        settings: as the score was made with.

    Raises:
        InputError: the table is missing or lacks a column.
    """
    cases = read_cases_table(folder / "cases.csv")
    measures = pd.DataFrame(measures_of(cases))
    write_measures(measures, FIRST, pages / "proof.csv")
    write_page(pages / "proof.md", cases, measures, settings)
    for drawing in draw_all(cases):
        save(drawing, folder)
