"""Stage `law_intervals`: a block of recordings of one effect's law, and the intervals of their fits."""

import mujoco
import pandas as pd
from threadpoolctl import threadpool_limits

from slapshot.calibration.coverage import calibrated_effects, intervals
from slapshot.command import Run, stage_command
from slapshot.config.calibration import LawBlockSettings
from slapshot.json_types import Row
from slapshot.progress import progress


def produce(run: Run) -> None:
    """Write intervals.csv: true value and interval of each parameter, variant and recording of the block."""
    # Fits try unstable models; MuJoCo's warnings about them are suppressed.
    mujoco.set_mju_user_warning(lambda text: None)
    own = run.settings(LawBlockSettings)
    rows: list[Row] = []
    todo = [(tested, own.first + k) for tested in calibrated_effects(own.effect) for k in range(own.count)]
    for tested, index in progress(todo, len(todo), own.effect):
        with threadpool_limits(1):  # as in a diagnosis
            rows += intervals(tested, own.seed + index, own.episodes, own.seconds)
    pd.DataFrame(rows).to_csv(run.out / "intervals.csv", index=False, float_format="%.9g")


if __name__ == "__main__":
    stage_command("law_intervals", produce)
