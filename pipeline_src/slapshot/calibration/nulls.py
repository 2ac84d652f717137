"""A null: a recording by the lab of a rig that conceals nothing, and the p-value of its nominal model."""

from collections.abc import Sequence

import mujoco
import numpy as np

from slapshot.diagnosis.diagnose import split
from slapshot.diagnosis.problem import Problem
from slapshot.diagnosis.rig import bind
from slapshot.diagnosis.search import nominal_step
from slapshot.diagnosis.segments import cut
from slapshot.lab.joints.case import make_case
from slapshot.lab.joints.order import Colour
from slapshot.lab.joints.rigs import nominal_model


def noise_of(index: int, colours: Sequence[Colour]) -> Colour:
    """Colour of the noise of a recording: they take turns."""
    return colours[index % len(colours)]


def null_p_value(rig: str, noise: Colour, seed: int, episodes: int, seconds: float) -> float:
    """P-value of the mismatch test of a nominal model that is the truth.

    Args:
        rig: of the joint lab.
        noise: colour of its encoders' noise.
        seed: of everything that is drawn.
        episodes: of the recording, those that a diagnosis holds out included.
        seconds: length of an episode.
    """
    recording, _ = make_case(rig, (), seed, noise=noise, episodes=episodes, seconds=seconds)
    nominal = bind(mujoco.MjSpec.from_string(nominal_model(rig)), recording.channels)
    used, _ = split(cut(recording, nominal))
    problem = Problem.of(nominal, recording.channels, used)
    return nominal_step(problem, (), np.random.default_rng(seed)).test.p_value
