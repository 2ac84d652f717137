"""Hidden effects of the swing, between command and arm position."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.lab.hidden_effects.hidden_effect import HiddenEffect, NominalMotion, Shape
from slapshot.scenes.scene import Scene

_STOP = (0.001, 1.0)  # solref of the stops of a joint with play: time constant (s), damping ratio
_PLAY_DAMPING = 0.2  # N m s/rad, of grease
_ZERO = 2.0  # rad/m, of a crooked arm's zeros over its links
_HIDDEN = 2  # combinations of errors that a crooked arm does not have


class CommandDelay(HiddenEffect):
    """Command delay that varies slightly between hits."""

    name = "command_delay"
    phase = "swing"
    parameter_match = "same"
    unit, amplitude, typical_amplitude, max_amplitude = "s", "mean delay", 0.02, 0.06
    observed_in = "track"
    changes_launch = True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"jitter_share": float(rng.uniform(0.02, 0.1))}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"delay": amplitude}

    def delay(self, amplitude: float, shape: Shape, chance: float) -> float:
        return max(0.0, amplitude * (1 + shape["jitter_share"] * chance))


class TrackingLag(HiddenEffect):
    """Commands pass a second-order filter, x'' = w^2 (u - x) - 2 z w x', different for each joint.

    Behind a steady motion it lags by 2 z / w, which is the amplitude on average over the joints.
    """

    name = "tracking_lag"
    phase = "swing"
    unit, amplitude, typical_amplitude, max_amplitude = "s", "lag behind a steady motion", 0.015, 0.06
    observed_in = "track"
    changes_launch = True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        shares = np.exp(rng.normal(0, 0.25, len(nominal.scene.info.joints)))
        return {"damping_ratio": float(rng.uniform(0.6, 1.2)), "joints": (shares / shares.mean()).tolist()}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"time": amplitude}

    def follow(self, amplitude: float, shape: Shape, values: Array, period: float) -> Array:
        from scipy.signal import cont2discrete, lfilter  # takes long to import, which other kinds do without

        followed = np.empty_like(values)
        damping = shape["damping_ratio"]
        for j, share in enumerate(shape["joints"]):
            w = 2 * damping / (amplitude * share)
            # Exact for commands that go straight from one tick to the next.
            rise, fall, _ = cont2discrete(([w**2], [1, 2 * damping * w, w**2]), period, "foh")
            start = values[0, j]
            followed[:, j] = start + lfilter(rise.ravel(), fall, values[:, j] - start)
        return followed

    def settling(self, amplitude: float, shape: Shape) -> float:
        return 3 * amplitude


class ServoGain(HiddenEffect):
    """Servo gains differ from the model by a factor for each joint; damping changes partly with them."""

    name = "servo_gain"
    phase = "swing"
    unit, amplitude, typical_amplitude, max_amplitude = (
        "1",
        "size of the mean logarithm of the factor",
        0.3,
        1.2,
    )
    observed_in = "track"
    changes_launch = True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        shares = 1 + rng.uniform(-0.5, 0.5, len(nominal.scene.info.joints))
        sign = float(rng.choice((-1.0, 1.0)))
        return {
            "joints": (sign * shares / shares.mean()).tolist(),
            "damping_share": float(rng.uniform(0.8, 1.0)),
        }

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"log_gain": amplitude * float(np.mean(shape["joints"]))}

    def edit(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, scene: Scene) -> None:
        shares = dict(zip(scene.info.joints, shape["joints"], strict=True))
        for actuator in spec.actuators:
            change = amplitude * shares[actuator.target]
            gain, bias = np.array(actuator.gainprm), np.array(actuator.biasprm)
            gain[0] *= np.exp(change)
            bias[1] *= np.exp(change)
            bias[2] *= np.exp(shape["damping_share"] * change)
            actuator.gainprm, actuator.biasprm = gain, bias


class JointElasticity(HiddenEffect):
    """Springs between some motors and their links; encoders are on the motors."""

    name = "joint_elasticity"
    phase = "swing"
    unit, amplitude, typical_amplitude, max_amplitude = (
        "rad/(N m)",
        "mean compliance of the springs",
        1e-4,
        2e-3,
    )
    changes_launch = True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        chosen = _some_joints(len(nominal.scene.info.joints), 3, 5, rng)
        shares = np.exp(rng.normal(0, 0.4, len(chosen)))
        weights = np.zeros(len(nominal.scene.info.joints))
        weights[chosen] = shares / shares.mean()
        return {
            "joints": weights.tolist(),
            # Damping over stiffness; implicit integration keeps a spring stable at steps below twice this.
            "loss_time_s": float(rng.uniform(8e-4, 2e-3)),
            "torque_limits": list(nominal.scene.info.torque_limits),
        }

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        of_joint = zip(shape["joints"], shape["torque_limits"], strict=True)
        return {f"twist_{j + 1}": amplitude * share * limit for j, (share, limit) in enumerate(of_joint)}

    def edit(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, scene: Scene) -> None:
        for name, share in zip(scene.info.joints, shape["joints"], strict=True):
            if share > 0:
                stiffness = 1 / (amplitude * share)
                _add_joint_behind(
                    spec,
                    name,
                    "spring",
                    stiffness=stiffness,
                    damping=stiffness * shape["loss_time_s"],
                    limited=mujoco.mjtLimited.mjLIMITED_FALSE,
                )


class Backlash(HiddenEffect):
    """Play between some motors and their links; encoders are on the motors."""

    name = "backlash"
    phase = "swing"
    unit, amplitude, typical_amplitude, max_amplitude = "rad", "mean play, from stop to stop", 0.005, 0.02
    observed_in = "track"
    changes_launch = True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        chosen = _some_joints(len(nominal.scene.info.joints), 2, 4, rng)
        shares = rng.uniform(0.5, 1.5, len(chosen))
        weights = np.zeros(len(nominal.scene.info.joints))
        weights[chosen] = shares / shares.mean()
        return {"joints": weights.tolist()}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        # Where all joints have the same play.
        return {"gap": amplitude * float(np.mean(shape["joints"]))}

    def edit(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, scene: Scene) -> None:
        unit = np.rad2deg(1.0) if spec.compiler.degree else 1.0
        for name, share in zip(scene.info.joints, shape["joints"], strict=True):
            if share > 0:
                _add_joint_behind(
                    spec,
                    name,
                    "play",
                    damping=_PLAY_DAMPING,
                    limited=mujoco.mjtLimited.mjLIMITED_TRUE,
                    range=np.array([-0.5, 0.5]) * amplitude * share * unit,
                    solref_limit=np.array(_STOP),
                )


class CrookedArm(HiddenEffect):
    """Links of another length and joints whose zero is off: the blade is not where the model says.

    The encoders look right. Where the arm strikes, the blade hangs nearly as high as it should, for an arm
    whose blade scraped, or missed, would have been mended. No effect of the catalogue is like it.
    """

    name = "crooked_arm"
    phase = "swing"
    catalogued = False
    parameter_match = None
    unit, amplitude, typical_amplitude, max_amplitude = (
        "m",
        "size of all links' errors, a zero's being 2 rad/m of it",
        0.02,
        0.05,
    )
    changes_launch = True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        joints = len(nominal.scene.info.joints)
        chosen = np.zeros((joints, 4), bool)
        chosen[rng.choice(np.arange(1, joints), 3, replace=False), :3] = True
        # Not the last one, whose zero is the blade's own angle.
        chosen[rng.choice(joints - 1, 3, replace=False), 3] = True
        errors = np.where(chosen, rng.normal(size=chosen.shape), 0.0)[chosen]
        # Without the combinations that raise or lower the blade most.
        heights = _height_slopes(nominal)[:, chosen]
        hidden = np.linalg.svd(heights, full_matrices=False)[2][:_HIDDEN]
        errors -= hidden.T @ (hidden @ errors)
        both = np.zeros(chosen.shape)
        both[chosen] = errors / np.linalg.norm(errors)
        return {"links": both[:, :3].tolist(), "zeros_rad_m": (both[:, 3] * _ZERO).tolist()}

    def edit(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, scene: Scene) -> None:
        for j, name in enumerate(scene.info.joints):
            joint = spec.joint(name)
            body = joint.parent
            body.pos = np.array(body.pos) + amplitude * np.array(shape["links"][j])
            turn, quat = np.empty(4), np.empty(4)
            mujoco.mju_axisAngle2Quat(turn, np.array(joint.axis), amplitude * shape["zeros_rad_m"][j])
            mujoco.mju_mulQuat(quat, np.array(body.quat), turn)
            body.quat = quat


def _height_slopes(nominal: NominalMotion) -> Array:
    """(poses, joints, 4) change of the striker's height over errors of a link and of a zero."""
    scene = nominal.scene
    model = scene.compile()
    data, site = mujoco.MjData(model), model.site(scene.info.striker_site).id
    slopes = np.empty((len(nominal.contact_poses), len(scene.info.joints), 4))
    for row, pose in zip(slopes, nominal.contact_poses, strict=True):
        data.qpos[scene.layout.arm_q] = pose
        mujoco.mj_kinematics(model, data)
        for j, name in enumerate(scene.info.joints):
            joint = model.joint(name).id
            body = model.jnt_bodyid[joint]
            row[j, :3] = data.xmat[model.body_parentid[body]].reshape(3, 3)[2]
            lever = data.site_xpos[site] - data.xanchor[joint]
            row[j, 3] = _ZERO * np.cross(data.xaxis[joint], lever)[2]
    return slopes


def _some_joints(count: int, low: int, high: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Indices of some joints; not the last, which carries too little for what is behind it to show."""
    return np.sort(rng.choice(count - 1, int(rng.integers(low, high + 1)), replace=False))


def _add_joint_behind(spec: mujoco.MjSpec, name: str, what: str, **properties: Any) -> None:
    """A joint on the link's side of the joint `name`, which stays the motor's."""
    motor = spec.joint(name)
    motor.parent.add_joint(
        name=f"{name}_{what}",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=np.array(motor.axis),
        pos=np.array(motor.pos),
        **properties,
    )
