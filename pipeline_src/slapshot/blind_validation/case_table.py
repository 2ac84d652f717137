"""Tables of the blind validation, written and read without loss except rounding.

cases.csv has a row for each scored case; measures, page and figures are made from it alone. proof.csv has the
measures of the proofs of all labs.
"""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from slapshot.errors import InputError, reading
from slapshot.json_types import Row
from slapshot.whole_file import write_whole

FIRST, JOINTS = "first", "joints"  # labs: pucks, joints
MEASURES = ("lab", "measure", "condition", "value", "low", "high", "n")
FIT = ("track_rmse_m", "rest_rmse_m", "command_rest_rmse_m", "loglik_per_hit", "chi2_per_freedom")
SCENES = ("nominal", "refitted", "augmented", "noise_floor")
_TEXTS = ("case", "condition", "conceals", "cannot_tell", "named", "classes", "phase", "variable")
COLUMNS = (
    *("case", "condition", "conceals", "displacement", "hits", "cannot_tell", "found", "p_value"),
    *("named", "classes", "class_size", "unknown", "phase", "variable"),
    *(f"{scene}_{measure}" for scene in SCENES for measure in FIT),
    *("phase_right", "top1", "top1_merged", "in_class", "both", "both_in_class", "one", "variable_right"),
    *("intervals", "intervals_held", "gain_share"),
)

# Of proofs since these are scored; empty in older ones.
NEWER_COLUMNS = ("stated_probability", "made_worse")


def write_cases_table(rows: Sequence[Row], file: Path) -> None:
    """Write scored cases; what does not apply to one is left empty."""
    pd.DataFrame(rows).reindex(columns=[*COLUMNS, *NEWER_COLUMNS]).to_csv(
        file, index=False, float_format="%.6g"
    )


def read_cases_table(file: Path) -> pd.DataFrame:
    """Scored cases: texts are "" and all else NaN where nothing applies.

    Raises:
        InputError: it is missing, or lacks a column.
    """
    table = _read(file, _TEXTS, "name the cases.csv of a proof")
    lacking = [column for column in COLUMNS if column not in table]
    if lacking:
        raise InputError(
            f"{file}: lacks the column{'s' * (len(lacking) > 1)} {', '.join(lacking)}, without which "
            "measures, page and figures cannot be made; run `snakemake proof` for a whole one"
        )
    return table.reindex(columns=[*table.columns, *(c for c in NEWER_COLUMNS if c not in table)])


def write_measures(measures: pd.DataFrame, lab: str, file: Path) -> None:
    """Write proof.csv; rows of other labs that stand in `file` already stay there.

    Args:
        measures: measure, condition, value, low, high, n.
        lab: that recorded the cases.
        file: may exist.
    """
    _merge(measures.assign(lab=lab), file)


def merge_measures(source: Path, target: Path) -> None:
    """Take the rows of `source` over into `target`, where rows of other labs stay.

    Raises:
        InputError: `source` is missing, or one of them lacks a column.
    """
    _merge(_measures(source), target)


def _merge(own: pd.DataFrame, file: Path) -> None:
    parts = [own]
    if file.is_file():
        before = _measures(file)
        parts.append(before[~before["lab"].isin(own["lab"])])
    table = pd.concat([part for part in parts if len(part)])[list(MEASURES)]
    text = table.sort_values("lab", kind="stable").to_csv(index=False, float_format="%.6g")
    # Six digits: whole percents that are rounded from them are those of the cases.
    write_whole(file, text)


def read_measures(file: Path, lab: str) -> pd.DataFrame:
    """Measures of one lab in proof.csv: measure, condition, value, low, high, n.

    Raises:
        InputError: it is missing, or lacks a column.
    """
    table = _measures(file)
    return table[table["lab"] == lab].drop(columns="lab").reset_index(drop=True)


def _measures(file: Path) -> pd.DataFrame:
    table = _read(file, ("lab", "measure", "condition"), "name the proof.csv of a proof")
    lacking = [column for column in MEASURES if column not in table]
    if lacking:
        raise InputError(f"{file}: lacks {', '.join(lacking)}; run `snakemake proof` for a whole one")
    return table


def _read(file: Path, texts: tuple[str, ...], remedy: str) -> pd.DataFrame:
    """A table whose texts stay texts: a condition is called `null`."""
    with reading(file, remedy):
        head = pd.read_csv(file, nrows=0).columns
        missing = {column: [""] for column in head if column not in texts}
        kinds = {column: str for column in head if column in texts}
        return pd.read_csv(file, keep_default_na=False, na_values=missing, dtype=kinds)
