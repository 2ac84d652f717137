"""Hidden effects of the contact between striker and object."""

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.lab.blade_truth import BladeTruth
from slapshot.lab.hidden_effects.hidden_effect import HiddenEffect, NominalMotion, Shape
from slapshot.scenes.scene import Scene

_SPEED = 1.5  # m/s, of a striker whose contact is that of the amplitude


class CompliantBlade(HiddenEffect):
    """The blade is cut into segments with springs in between; see `blade`."""

    name = "compliant_blade"
    phase = "contact"
    unit, amplitude, typical_amplitude, max_amplitude = (
        "rad/(N m)",
        "compliance of all its hinges in series",
        0.02,
        0.1,
    )
    min_amplitude = 1e-3  # needs steps of 10 microseconds
    changes_launch = True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {
            # Three take steps seven times finer than two.
            "segments": int(rng.choice([2, 2, 2, 3])),
            "damping_ratio": float(rng.uniform(0.1, 0.3)),
            "twist_ratio": float(rng.uniform(2.0, 5.0)) if rng.uniform() < 0.5 else None,
        }

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"compliance": amplitude}

    def blade(self, amplitude: float, shape: Shape) -> BladeTruth:
        ratio = shape["twist_ratio"]
        return BladeTruth(
            segments=shape["segments"],
            stiffness=1 / amplitude,
            twist_stiffness=None if ratio is None else ratio / amplitude,
            damping_ratio=shape["damping_ratio"],
        )


class Restitution(HiddenEffect):
    """The contact damping differs from the model: the damping ratio z becomes z f.

    With log f = sign amplitude (v / 1.5 m/s)^p it depends a little on the striker's speed v, as of
    viscoelastic bodies (Tabor 1948; Brilliantov 1996: 1 - e ~ v^(1/5)). The frequency 1 / (T z) would stay
    with a time constant T / f; it changes by f^-s.
    """

    name = "restitution"
    phase = "contact"
    unit, amplitude, typical_amplitude, max_amplitude = (
        "1",
        "size of the logarithm of the damping ratio's factor",
        0.3,
        0.9,
    )
    changes_launch = True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {
            "sign": float(rng.choice((-1.0, 1.0))),
            "speed_power": float(rng.uniform(0.05, 0.25)),
            "stiffness_share": float(rng.choice((-1.0, 1.0)) * rng.uniform(0.1, 0.3)),
        }

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"log_damping": shape["sign"] * amplitude}

    def bounce(self, amplitude: float, shape: Shape, solref: Array, speed: float) -> Array:
        log_factor = shape["sign"] * amplitude * (speed / _SPEED) ** shape["speed_power"]
        return solref * np.exp(np.array([shape["stiffness_share"] - 1, 1]) * log_factor)


class BladeFriction(HiddenEffect):
    """Friction between blade and object differs from the model."""

    name = "blade_friction"
    phase = "contact"
    parameter_match = "same"
    unit, amplitude, typical_amplitude, max_amplitude = (
        "1",
        "size of the logarithm of the factor on friction",
        0.5,
        1.5,
    )
    changes_launch = True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"sign": float(rng.choice((-1.0, 1.0)))}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"log_factor": shape["sign"] * amplitude}

    def edit(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, scene: Scene) -> None:
        for pair in _striker_pairs(spec, scene):
            friction = np.array(pair.friction)
            friction[:2] *= np.exp(shape["sign"] * amplitude)
            pair.friction = friction


class BladeYaw(HiddenEffect):
    """The blade is turned in its clamp, about the stick, and rolled a little in the plane of its face."""

    name = "blade_yaw"
    phase = "contact"
    parameter_match = "same"
    unit, amplitude, typical_amplitude, max_amplitude = "rad", "size of the angle about the stick", 0.05, 0.3
    changes_launch = True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"sign": float(rng.choice((-1.0, 1.0))), "roll_share": float(rng.uniform(-0.3, 0.3))}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"angle": -shape["sign"] * amplitude}  # about the stick's axis upwards

    def edit(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, scene: Scene) -> None:
        # Site and striker share a body, whose z points along the stick and x against the object.
        body = spec.site(scene.info.striker_site).parent
        quat, turn = np.array(body.quat), np.empty(4)
        for axis, angle in ((2, shape["sign"] * amplitude), (0, shape["roll_share"] * amplitude)):
            mujoco.mju_axisAngle2Quat(turn, np.eye(3)[axis], angle)
            mujoco.mju_mulQuat(quat, quat.copy(), turn)
        body.quat = quat


class CurvedBlade(HiddenEffect):
    """The blade's face bulges: where along the blade it strikes decides where the object goes.

    The box stays as it is seen and weighs; what touches is a cylinder along its height, the front of
    which stands where the box's face stood. No effect of the catalogue is like it.
    """

    name = "curved_blade"
    phase = "contact"
    catalogued = False
    parameter_match = None
    unit, amplitude, typical_amplitude, max_amplitude = "1/m", "curvature of the face", 1.0, 6.0
    changes_launch = True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"apex_m": float(rng.uniform(-0.02, 0.02))}

    def edit(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, scene: Scene) -> None:
        radius = 1 / amplitude
        for pair in _striker_pairs(spec, scene):
            for end in ("geomname1", "geomname2"):
                box = spec.geom(getattr(pair, end))
                if box.parent.name == scene.info.object_body:
                    continue
                size = np.array(box.size)
                thin, up, across = np.argsort(size)
                front = np.eye(3)[thin] * _facing(box, spec, scene)
                axis = np.zeros(4)
                mujoco.mju_quatZ2Vec(axis, np.eye(3)[up])
                face = box.parent.add_geom(
                    name=f"{box.name}_face",
                    type=mujoco.mjtGeom.mjGEOM_CYLINDER,
                    size=[radius, size[up], 0],
                    pos=box.pos + front * (size[thin] - radius) + np.eye(3)[across] * shape["apex_m"],
                    quat=axis,
                    mass=0,
                    contype=0,
                    conaffinity=0,
                    rgba=[0, 0, 0, 0],
                )
                setattr(pair, end, face.name)


def _facing(box: mujoco.MjsGeom, spec: mujoco.MjSpec, scene: Scene) -> float:
    """1 if the box's thin axis points where its site's x axis does, -1 if away."""
    thin = int(np.argmin(box.size))
    normal = np.empty(3)
    mujoco.mju_rotVecQuat(normal, np.array([1.0, 0, 0]), np.array(spec.site(scene.info.striker_site).quat))
    return 1.0 if normal[thin] >= 0 else -1.0


def _striker_pairs(spec: mujoco.MjSpec, scene: Scene) -> list[mujoco.MjsPair]:
    """Of the striker, or of each of its segments, and the object."""
    return [pair for pair in spec.pairs if pair.name != scene.info.object_pair]
