"""Stage `coverage`: do refined ranges contain the truth? The only module here that opens sealed truths."""

import json
import logging

import pandas as pd

from slapshot.command import Run, stage_command
from slapshot.parquet import read_frame, write_table

log = logging.getLogger("slapshot")

# Parameters that a rig has: a rig's torsional friction is in m, like a condition's.
_TRUTHS = {
    "mass": lambda truth: truth["mass"],
    "friction_x": lambda truth: truth["friction_x"],
    "friction_y": lambda truth: truth["friction_y"] / truth["friction_x"],
    "friction_torsional": lambda truth: truth["friction_torsional"],
}


def produce(run: Run) -> None:
    """Write coverage.parquet and simulated.parquet.

    coverage: rows of refinement.parquet whose true value is known, with `truth` and `inside`. simulated:
    `inside` for the validation conditions.
    """
    simulated = read_frame(run.inputs["refinement"] / "simulated.parquet")
    simulated["inside"] = simulated["truth"].between(simulated["low"], simulated["high"])
    write_table(simulated, run.out / "simulated.parquet")
    table = read_frame(run.inputs["refinement"] / "refinement.parquet")
    rows = []
    for row in table[table["parameter"].isin(_TRUTHS)].to_dict("records"):
        folder = run.inputs[f"lab/{row['recording']}/{row['rig']}"]
        rig = json.loads((folder / "truth" / "truth.json").read_text())["rig"]
        truth = _TRUTHS[row["parameter"]](rig["objects"][row["object"]])
        # A true value outside the prior's range cannot be found by refining that range.
        drawable = row["prior_low"] <= truth <= row["prior_high"]
        inside = row["low"] <= truth <= row["high"]
        rows.append({**row, "truth": truth, "inside": inside, "drawable": drawable})
    found = pd.DataFrame(rows)
    write_table(found, run.out / "coverage.parquet")
    for where, table in (("rigs", found[found["drawable"]]), ("simulation", simulated)):
        for parameter, share in table.groupby("parameter")["inside"].mean().items():
            log.info("%s, %s: %.0f %% of truths inside", where, parameter, 100 * share)


if __name__ == "__main__":
    stage_command("coverage", produce)
