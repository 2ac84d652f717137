"""The published proof, from its scored cases alone: proof.csv, proof.md and figures P1 to P4.

The page shows the measures beside their aims, and the confusions that remain.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from slapshot.blind_validation.case_table import FIRST, read_cases_table, write_measures
from slapshot.blind_validation.figures import draw_all
from slapshot.blind_validation.measures import ALL, measures_of
from slapshot.config.cases import ProofSettings
from slapshot.plotting import save
from slapshot.text import markdown_table

# Measure, condition -> aim: text, and bounds of the value (None for none).
AIMS: dict[tuple[str, str], tuple[str, float | None, float | None]] = {
    ("false_alarm", "null"): ("at most 2 %", None, 0.02),
    ("false_alarm", "null, cluttered"): ("at most 5 %", None, 0.05),
    ("false_alarm", "null, rest points only"): ("at most 2 %", None, 0.02),
    ("p_below_05", "null"): ("3 to 8 %", 0.03, 0.08),
    ("naming_top1", "plain"): ("at least 95 %", 0.95, None),
    ("naming_top1_drags_merged", "plain"): ("at least 97 %", 0.97, None),
    ("naming_top1", "launch"): ("at least 85 %", 0.85, None),
    ("naming_top1", "plain, tracks only"): ("at least 80 %", 0.80, None),
    ("naming_top1", "plain, rest points only"): ("at least 70 %", 0.70, None),
    ("naming_top1", "weak"): ("at least 80 %", 0.80, None),
    ("in_class", "plain"): ("at least 97 %", 0.97, None),
    ("in_class", "weak"): ("at least 93 %", 0.93, None),
    ("phase_right", "plain"): ("at least 97 %", 0.97, None),
    ("variable_right", "plain"): ("at least 90 %", 0.90, None),
    ("both_named", "pairs"): ("at least 70 %", 0.70, None),
    ("one_named", "pairs"): ("at least 97 %", 0.97, None),
    ("detected", "uncatalogued"): ("at least 97 %", 0.97, None),
    ("unknown_flagged", "uncatalogued"): ("at least 85 %", 0.85, None),
    ("false_unknown", "plain"): ("at most 5 %", None, 0.05),
    ("coverage90", "plain"): ("85 to 95 %", 0.85, 0.95),
    ("gain_over_true_family", "plain"): ("at least 0.95 in the median", 0.95, None),
    ("chi2_per_freedom", "plain"): ("0.9 to 1.15", 0.9, 1.15),
    ("track_error_over_floor", "plain"): ("at most 1.10", None, 1.10),
    ("rest_error_from_command_over_floor", "plain"): ("at most 1.10", None, 1.10),
    ("made_worse", ALL): ("none", None, 0.0),
    ("sure_and_wrong", ALL): ("at most 3 %", None, 0.03),
}
_RATIO = ("_over_", "chi2", "class_size")

INTRODUCTION = """# The proof: concealed physics, diagnosed, then scored

A stand-in lab (simulated; no real robot) draws rigs that differ from the nominal scene in friction and mass,
scatter from hit to hit, are seen by a noisy camera, and conceal something or nothing. The diagnosis is given
the recording and the nominal scene; only the step that wrote this page opened the sealed truths.
"""


def write_page(
    file: Path,
    cases: pd.DataFrame,
    measures: pd.DataFrame,
    settings: ProofSettings,
    listed: int | None = None,
) -> None:
    """Write the page.

    Args:
        file: to write.
        cases: of cases.csv.
        measures: of proof.csv.
        settings: as the score was made with.
        listed: number of cases of the list that they are some of; None for all of it.
    """
    small = settings.list != "full"
    parts = [INTRODUCTION]
    if small:
        reported = "Its intervals are wide; `snakemake proof` makes the full one."
        parts.append(f"**A small proof: {len(cases)} cases.** {reported}\n")
    if listed is not None and listed > len(cases):
        parts.append(
            f"**{len(cases)} of {listed} cases,** which were listed in random order: the others have not "
            "been diagnosed by this method, and intervals are wide.\n"
        )
    shown = measures[measures["n"] > 0]
    aimed = [row for row in shown.to_dict("records") if (row["measure"], row["condition"]) in AIMS]
    parts += [
        "## Aims\n",
        markdown_table(
            ("measure", "condition", "aim", "measured", "n", "reached"), [_aim_row(row) for row in aimed]
        ),
    ]
    parts += [
        "\n## All measures\n",
        "Intervals are 95 %: Wilson's for shares, a bootstrap over cases for medians. Hits are those of one "
        "recording, of both pucks together; n counts cases, or intervals for coverage90.\n",
    ]
    hits = cases.groupby("condition")["hits"].agg(lambda column: " or ".join(map(str, column.unique())))
    rows = [
        (r["measure"], r["condition"], hits.get(r["condition"], ALL), _number(r), str(r["n"]))
        for r in shown.to_dict("records")
    ]
    parts.append(markdown_table(("measure", "condition", "hits", "value", "n"), rows))
    parts += ["\n## What was taken for something else\n", _confusions(cases)]
    parts += ["\n## How hits were made\n", _recording_setup(settings)]
    file.write_text("\n".join(parts) + "\n")


def _aim_row(row: Mapping[Any, Any]) -> tuple[str, ...]:
    measure, condition = row["measure"], row["condition"]
    met = "yes" if meets_aim(measure, condition, row["value"]) else "**no**"
    return measure, condition, AIMS[measure, condition][0], _number(row), str(row["n"]), met


def _number(row: Mapping[Any, Any]) -> str:
    if any(part in row["measure"] for part in _RATIO):
        return f"{row['value']:.2f} ({row['low']:.2f} to {row['high']:.2f})"
    return f"{percent(row['value'])} % ({percent(row['low'])} to {percent(row['high'])})"


def percent(share: float) -> str:
    """A share in percent: whole, but with one decimal where rounding would make nothing or all of it."""
    number = 100 * share
    return f"{number:.{int(0 < number < 1 or 99 < number < 100)}f}".removesuffix(".0")


def meets_aim(measure: str, condition: str, value: float) -> bool:
    """Whether a measure's value lies within its aim."""
    _, low, high = AIMS[measure, condition]
    return (low is None or value >= low) and (high is None or value <= high)


def _confusions(cases: pd.DataFrame) -> str:
    """Catalogued cases whose first name is not what was concealed, and nulls that were called mismatched."""
    wrong = cases[(cases["conceals"] != "") & ~cases["top1"].fillna(True).astype(bool)]
    alarms = cases[(cases["conceals"] == "") & cases["found"].astype(bool)]
    shown = pd.concat([wrong, alarms]).sort_values(["condition", "conceals"])
    if not len(shown):
        return "Nothing."
    rows = [
        (
            r["case"],
            r["condition"],
            r["conceals"] or "nothing",
            "" if pd.isna(r["displacement"]) else f"{r['displacement']:.2f}",
            r["named"] or "nothing",
            r["classes"].replace(" | ", "; "),
            "yes" if r["unknown"] is True else "",
        )
        for r in shown.to_dict("records")
    ]
    return markdown_table(("case", "condition", "concealed", "size", "named", "classes", "unknown"), rows)


def _recording_setup(settings: ProofSettings) -> str:
    pool, camera, joints = settings.pool, settings.lab.camera, settings.lab.joints
    low, high = pool.speed_m_s
    reach = 100 * pool.contact_offset_m
    return (
        f"Commands come from a pool of {pool.count} tasks: headings to +-{pool.heading_rad:.2f} rad, "
        f"striker speeds {low:g} to {high:g} m/s, contact points to +-{reach:.0f} cm along the blade; "
        "a recording of more hits than that repeats some of them. Two pucks of unknown friction. "
        f"Camera: {1e3 * camera.noise_sd_m:g} mm at {camera.rate_hz:g} Hz; "
        f"encoders {1e3 * joints.noise_sd_rad:g} mrad at {joints.rate_hz:g} Hz. Sizes are rms shifts "
        "of rest points (of tracks, where rest points do not move) over the hit-to-hit scatter of repeated "
        "commands; a kind that cannot be as large as was drawn is listed under a condition of smaller "
        "effects."
    )


def publish_proof(folder: Path, pages: Path, settings: ProofSettings, listed: int | None = None) -> None:
    """Write proof.csv, proof.md and P1 to P4 from cases.csv.

    Args:
        folder: with cases.csv; gets the figures.
        pages: gets proof.csv and proof.md.
        settings: as the score was made with.
        listed: see `write_page`.

    Raises:
        InputError: the table is missing or lacks a column.
    """
    cases = read_cases_table(folder / "cases.csv")
    measures = pd.DataFrame(measures_of(cases))
    write_measures(measures, FIRST, pages / "proof.csv")
    write_page(pages / "proof.md", cases, measures, settings, listed)
    for drawing in draw_all(cases):
        save(drawing, folder)
