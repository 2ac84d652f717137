"""`python -m slapshot.blind_validation.docs_table`: the table of docs/proof.md from figures/proof.csv."""

import argparse
import sys
from pathlib import Path

import pandas as pd

from slapshot.blind_validation.case_table import FIRST, read_measures
from slapshot.blind_validation.page import AIMS, meets_aim, percent
from slapshot.errors import InputError, reading, writing

BEGIN = "<!-- From figures/proof.csv by `python -m slapshot.blind_validation.docs_table`; do not edit. -->"
END = "<!-- End of the table. -->"

# What was asked -> measure and condition of proof.csv.
ROWS = {
    "nothing concealed: a mismatch is found by mistake": ("false_alarm", "null"),
    "nothing concealed, cluttered data: found by mistake": ("false_alarm", "null, cluttered"),
    "nothing concealed: p below .05": ("p_below_05", "null"),
    "one effect of slide or camera, at least half as large as the scatter from hit to hit: named first": (
        "naming_top1",
        "plain",
    ),
    "the same: it is in the class that is named": ("in_class", "plain"),
    "the same: the phase is right": ("phase_right", "plain"),
    "the same: something unknown is claimed besides, which is not there": ("false_unknown", "plain"),
    "the same from 25 hits (13 of each puck): named first": ("naming_top1", "plain, 25 hits"),
    "the same from 50 hits: named first": ("naming_top1", "plain, 50 hits"),
    "the same from tracks only: named first": ("naming_top1", "plain, tracks only"),
    "the same from rest points and commands only: named first": ("naming_top1", "plain, rest points only"),
    "one of slide or camera, of 0.2 to 0.5 of that scatter: named first": ("naming_top1", "weak"),
    "swing or contact, 100 hits with encoders: named first": ("naming_top1", "launch"),
    "two effects at once: one of them is named": ("one_named", "pairs"),
    "two effects at once: both are named": ("both_named", "pairs"),
    "physics in no catalogue: a mismatch is found": ("detected", "uncatalogued"),
    "physics in no catalogue: called unknown, or found and not named": ("unknown_flagged", "uncatalogued"),
    "any name with a stated probability above .9: it is wrong": ("sure_and_wrong", "all"),
    "all verdicts: what is named makes a held-out error worse": ("made_worse", "all"),
    "90 % intervals of a found effect's parameters: they hold the truth": ("coverage90", "plain"),
}


def table(measures: pd.DataFrame) -> str:
    """The table in Markdown; of a condition that no case has yet it says so.

    Args:
        measures: of proof.csv.

    Raises:
        InputError: a row is missing there.
    """
    found = {(row["measure"], row["condition"]): row for row in measures.to_dict("records")}
    conditions = set(measures["condition"])
    head = ("200 hits, or as many as stand there", "cases", "share (95 % interval)", "aim")
    lines = [f"| {' | '.join(head)} |", "|---|---|---|---|"]
    for text, key in ROWS.items():
        if key[1] not in conditions:
            lines.append(f"| {text} | none yet |  | {AIMS[key][0] if key in AIMS else ''} |")
            continue
        if key not in found:
            raise InputError(f"proof.csv: no row {key[0]}, {key[1]}; use the one of the full proof")
        value, low, high, n = (found[key][name] for name in ("value", "low", "high", "n"))
        share = f"{percent(value)} % ({percent(low)} to {percent(high)})"
        aim = f"{AIMS[key][0]}: {'met' if meets_aim(*key, value) else '**missed**'}" if key in AIMS else ""
        lines.append(f"| {text} | {round(value * n)} of {n} | {share} | {aim} |")
    return "\n".join(lines)


def with_table(text: str, made: str) -> str:
    """The text of a page with the table between its two marks.

    Raises:
        InputError: the marks are not there, once each and in order.
    """
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not begin or not end or BEGIN in rest or END in head + tail:
        raise InputError(f"page: needs the lines {BEGIN} and {END}, once each and in this order")
    return f"{head}{BEGIN}\n\n{made}\n\n{END}{tail}"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.blind_validation.docs_table")
    parser.add_argument("--page", type=Path, default=Path("docs/proof.md"))
    parser.add_argument("--measures", type=Path, default=Path("figures/proof.csv"))
    args = parser.parse_args()
    try:
        with reading(args.page, "run this in the top folder of the repository"):
            text = args.page.read_text()
        text = with_table(text, table(read_measures(args.measures, FIRST)))
        with writing(args.page):
            args.page.write_text(text)
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
