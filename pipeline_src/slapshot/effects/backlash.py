"""Backlash: play in the arm's gears."""

from collections.abc import Mapping

import mujoco
import numpy as np

from slapshot.effects.effect import Effect, Parameter
from slapshot.effects.joint_elasticity import add_behind_motor
from slapshot.scenes.scene import SceneInfo

# kg m^2, of the teeth: lets play and twist of one joint be simulated at once, small against any link.
TEETH = 1e-5
# Hard flanks: time constant in s (MuJoCo takes two steps if that is longer) and damping ratio.
FLANK_SOLREF = (4e-4, 1.0)
FLANK_SOLIMP = (0.98, 0.99, 1e-4, 0.5, 2.0)


class Backlash(Effect):
    name = "backlash"
    phase = "swing"
    follows = "command"
    parameters = (Parameter("gap", "rad", 0.0, 0.05, 0.003, "play of each joint, from flank to flank"),)
    physics = (
        "Play between motor and link of every joint: teeth push on one flank, on the other, or on none.\n"
        "Links lean on the flank that drives them, change sides where they slow down, and give at the impact."
    )
    source = "Nordin and Gutman 2002, Controlling mechanical systems with backlash (Automatica 38)"
    known_to = 0.3  # joints of one arm differ, and have one value here

    def edit(self, values: Mapping[str, float], spec: mujoco.MjSpec, info: SceneInfo) -> None:
        """Add joints `<joint>_play`; motor angles stay the scene's joints, links turn by both."""
        gap = values["gap"]
        if gap == 0:
            return
        for name in info.joints:
            play = add_behind_motor(spec, name, f"{name}_play")
            half = np.rad2deg(gap / 2) if spec.compiler.degree and _turns(play) else gap / 2
            play.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            play.range = (-half, half)
            play.armature = TEETH
            play.solref_limit = FLANK_SOLREF
            play.solimp_limit = FLANK_SOLIMP


def _turns(joint: mujoco.MjsJoint) -> bool:
    return joint.type == mujoco.mjtJoint.mjJNT_HINGE
