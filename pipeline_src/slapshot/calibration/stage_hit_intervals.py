"""Stage `hit_intervals`: a block of recordings of one effect on hits, and the intervals of their fits."""

import pandas as pd
from threadpoolctl import threadpool_limits

from slapshot.calibration.hit_coverage import intervals
from slapshot.command import Run, stage_command
from slapshot.config.calibration import HitBlockSettings
from slapshot.json_types import Row
from slapshot.progress import progress


def produce(run: Run) -> None:
    """Write intervals.csv: true value and interval of each parameter and recording of the block."""
    own = run.settings(HitBlockSettings)
    rows: list[Row] = []
    for index in progress(range(own.first, own.first + own.count), own.count, own.effect):
        with threadpool_limits(1):  # as in a diagnosis
            rows += intervals(own.effect, own.seed + index, own.hits)
    pd.DataFrame(rows).to_csv(run.out / "intervals.csv", index=False, float_format="%.9g")


if __name__ == "__main__":
    stage_command("hit_intervals", produce)
