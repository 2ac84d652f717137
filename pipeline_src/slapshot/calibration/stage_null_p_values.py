"""Stage `null_p_values`: a block of null recordings, and their p-values."""

import mujoco
import pandas as pd

from slapshot.calibration.nulls import noise_of, null_p_value
from slapshot.command import Run, stage_command
from slapshot.config.calibration import NullBlockSettings
from slapshot.progress import progress


def produce(run: Run) -> None:
    """Write p_values.csv: rig, noise, seed and p-value of each recording of the block."""
    # Fits try models that blow up; nobody needs to read of each.
    mujoco.set_mju_user_warning(lambda text: None)
    own = run.settings(NullBlockSettings)
    rows = []
    for index in progress(range(own.first, own.first + own.count), own.count, "nulls"):
        noise, seed = noise_of(index, own.noise), own.seed + index
        p_value = null_p_value(own.rig, noise, seed, own.episodes, own.seconds)
        rows.append({"rig": own.name, "noise": noise, "seed": seed, "p_value": p_value})
    pd.DataFrame(rows).to_csv(run.out / "p_values.csv", index=False, float_format="%.9g")


if __name__ == "__main__":
    stage_command("null_p_values", produce)
