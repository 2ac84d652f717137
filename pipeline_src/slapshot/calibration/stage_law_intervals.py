"""Stage `law_intervals`: a block of recordings of one effect's law, and the intervals of their fits."""

from typing import Any

import mujoco
import pandas as pd

from slapshot.calibration.coverage import intervals, laws
from slapshot.command import Run, stage_command
from slapshot.config.calibration import LawBlockSettings
from slapshot.progress import progress


def produce(run: Run) -> None:
    """Write intervals.csv: true value and interval of each parameter, variant and recording of the block."""
    # Fits try models that blow up; nobody needs to read of each.
    mujoco.set_mju_user_warning(lambda text: None)
    own = run.settings(LawBlockSettings)
    rows: list[dict[str, Any]] = []
    todo = [(law, own.first + k) for law in laws(own.effect) for k in range(own.count)]
    for law, index in progress(todo, len(todo), own.effect):
        rows += intervals(law, own.seed + index, own.episodes, own.seconds)
    pd.DataFrame(rows).to_csv(run.out / "intervals.csv", index=False, float_format="%.9g")


if __name__ == "__main__":
    stage_command("law_intervals", produce)
