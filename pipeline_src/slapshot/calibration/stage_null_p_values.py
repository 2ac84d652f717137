"""Stage `null_p_values`: a block of null recordings, and the p-value of the nominal model of each."""

from collections.abc import Sequence

import mujoco
import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from slapshot.command import Run, stage_command
from slapshot.config.calibration import NullBlockSettings
from slapshot.diagnosis.held_out_split import split
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.diagnosis.selection.problem import Problem
from slapshot.diagnosis.selection.steps import nominal_motion, nominal_step
from slapshot.lab.joints.case_spec import Colour
from slapshot.lab.joints.record_case import make_case
from slapshot.lab.joints.rigs import nominal_model
from slapshot.progress import progress


def noise_colour(index: int, colours: Sequence[Colour]) -> Colour:
    """Noise colour of a recording; colours alternate."""
    return colours[index % len(colours)]


def null_p_value(
    rig: str, noise: Colour, seed: int, episodes: int, seconds: float, cluttered: bool = False
) -> float:
    """P-value of the mismatch test of a nominal model that is the truth.

    Args:
        rig: of the joint lab.
        noise: colour of its encoders' noise.
        seed: of everything that is drawn.
        episodes: of the recording, those that a diagnosis holds out included.
        seconds: length of an episode.
        cluttered: whether the rig's laws err and readings are worse than noisy, see `make_case`.
    """
    recording, _ = make_case(
        rig, (), seed, noise=noise, cluttered=cluttered, episodes=episodes, seconds=seconds
    )
    nominal = bind(mujoco.MjSpec.from_string(nominal_model(rig)), recording.channels)
    used, _ = split(segment_recording(recording, nominal))
    problem = Problem.of(nominal, recording.channels, used)
    return nominal_step(nominal_motion(problem, ()), np.random.default_rng(seed)).test.p_value


def produce(run: Run) -> None:
    """Write p_values.csv: rig, noise, whether cluttered, seed and p-value of each recording of the block."""
    # Fits try unstable models; MuJoCo's warnings about them are suppressed.
    mujoco.set_mju_user_warning(lambda text: None)
    own = run.settings(NullBlockSettings)
    rows = []
    for index in progress(range(own.first, own.first + own.count), own.count, "nulls"):
        noise, seed = noise_colour(index, own.noise), own.seed + index
        with threadpool_limits(1):  # as in a diagnosis
            p_value = null_p_value(own.rig, noise, seed, own.episodes, own.seconds, own.cluttered)
        rows.append(
            {"rig": own.name, "noise": noise, "cluttered": own.cluttered, "seed": seed, "p_value": p_value}
        )
    pd.DataFrame(rows).to_csv(run.out / "p_values.csv", index=False, float_format="%.9g")


if __name__ == "__main__":
    stage_command("null_p_values", produce)
