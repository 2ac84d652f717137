"""Stage `null_table`: are p-values of nulls uniform?"""

import pandas as pd

from slapshot.calibration.null_table import write_nulls
from slapshot.command import Run, stage_command
from slapshot.config.calibration import TableSettings


def produce(run: Run) -> None:
    """Write joint_nulls.csv, the page, the figure and all p-values."""
    blocks = [pd.read_csv(run.inputs[block] / "p_values.csv") for block in run.settings(TableSettings).blocks]
    write_nulls(pd.concat(blocks, ignore_index=True), run.out)


if __name__ == "__main__":
    stage_command("null_table", produce)
