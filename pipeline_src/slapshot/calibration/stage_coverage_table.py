"""Stage `coverage_table`: do 90 % intervals hold 90 % of true values?"""

import pandas as pd

from slapshot.calibration.coverage_table import write_coverage
from slapshot.command import Run, stage_command
from slapshot.config.calibration import TableSettings


def produce(run: Run) -> None:
    """Write coverage.csv, the page and all intervals."""
    texts = {"variant": str, "state": str}
    blocks = [
        pd.read_csv(run.inputs[block] / "intervals.csv", dtype=texts, keep_default_na=False,
                    na_values={"value": [""], "low": [""], "high": [""]})
        for block in run.settings(TableSettings).blocks
    ]  # fmt: skip
    write_coverage(pd.concat(blocks, ignore_index=True), run.out)


if __name__ == "__main__":
    stage_command("coverage_table", produce)
