from dataclasses import replace

import numpy as np
import pytest
from slapshot.lab.joints.effect_size_calibration import EffectSizeCalibration
from slapshot.lab.joints.rig import draw_excitation
from slapshot.lab.joints.rigs import rig_named

EPISODES, SECONDS = 3, 0.6


def short(name):
    """A rig that does not wait long for its first command."""
    return replace(rig_named(name), settle=0.12)


@pytest.fixture(scope="session")
def size_calibrations():
    """Rig -> rehearsal of a short session."""
    found = {}
    for name in ("pendulum", "arm", "fetchslide_arm"):
        rig = short(name)
        excitation = draw_excitation(rig, EPISODES, SECONDS, np.random.default_rng(7))
        found[name] = EffectSizeCalibration(rig, excitation)
    return found
