"""Hidden effects of the base: tilt, compliance and slip."""

from typing import Any

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.lab.joints.hidden_effect import (
    Bounds,
    HiddenEffect,
    Law,
    NominalMotion,
    Plant,
    Shape,
    StepState,
)
from slapshot.lab.joints.hidden_effects.friction import Bristles
from slapshot.lab.joints.hidden_effects.structure import linear
from slapshot.lab.joints.rig import Rig

_TILT, _SLIP = "lab_base_", "lab_slip"


class GravityTilt(HiddenEffect):
    """Tilted base, which changes the direction of gravity. Gravity compensation hides it."""

    name = "gravity_tilt"
    unit, amplitude = "rad", "angle to the upright"

    def fits(self, rig: Rig) -> bool:
        return bool(rig.loaded)

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        # Where level axes are alike, gravity must lean across them to show.
        lean = np.pi / 3 if nominal.rig.turns == "slide" else np.pi
        return {"towards_rad": float(rng.uniform(-lean, lean) + np.pi * rng.integers(2))}

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.02, 0.0, 1.0)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        away, towards = np.sin(amplitude), shape["towards_rad"]
        return {"gravity_x": (away * np.cos(towards), "1"), "gravity_y": (away * np.sin(towards), "1")}

    def tune(self, amplitude: float, shape: Shape, model: mujoco.MjModel, rig: Rig) -> None:
        size, towards = np.linalg.norm(model.opt.gravity), shape["towards_rad"]
        away = np.sin(amplitude)
        model.opt.gravity = size * np.array(
            (away * np.cos(towards), away * np.sin(towards), -np.cos(amplitude))
        )


class BaseCompliance(HiddenEffect):
    """Compliant mounting about both horizontal axes. Stiff servos hardly excite it."""

    name = "base_compliance"
    unit, amplitude = "rad/(N m)", "mean compliance about both axes"

    def fits(self, rig: Rig) -> bool:
        return bool(rig.loaded) and rig.drive != "mocap"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {
            "body": nominal.rig.base,
            "ratio": float(np.exp(rng.uniform(-0.7, 0.7))),
            "damping_ratio": float(rng.uniform(0.05, 0.2)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(1e-3, 1e-6, 0.05)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        share = 2 / (1 + shape["ratio"])
        return {
            "about_x": (1 / (amplitude * share), "N m/rad"),
            "about_y": (1 / (amplitude * share * shape["ratio"]), "N m/rad"),
        }

    def build(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, rig: Rig) -> None:
        inertia = _inertia_about_foot(rig)
        for axis, stiffness in zip("xy", self.parameters(amplitude, shape).values(), strict=True):
            _base_joint(
                spec,
                rig,
                name=_TILT + axis,
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=[float(axis == "x"), float(axis == "y"), 0],
                stiffness=linear(stiffness[0]),
                damping=linear(2 * shape["damping_ratio"] * np.sqrt(inertia * stiffness[0])),
            )


class SlippingBase(HiddenEffect):
    """The base stands on feet that stick and slip.

    It has no counterpart in the catalogue. Stiff servos do not excite it.
    """

    name = "slipping_base"
    catalogued = False
    unit, amplitude = "1/(N m) or 1/N", "one over the feet's sliding friction"

    def fits(self, rig: Rig) -> bool:
        return bool(rig.loaded) and rig.drive != "mocap"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {
            "body": nominal.rig.base,
            "direction": nominal.rig.turns,
            "static_over_sliding": float(rng.uniform(1.1, 1.6)),
            "stribeck_per_s": float(rng.uniform(0.01, 0.05)),
            "bend": float(rng.uniform(1e-4, 3e-4)),
            "damping_time_s": float(rng.uniform(1e-3, 3e-3)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        force = nominal.peak(0) / (0.35 if nominal.rig.turns == "slide" else 1.0)
        return Bounds(1.3 / force, 0.02 / force, 50 / force)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"friction": (1 / amplitude, "N" if shape["direction"] == "slide" else "N m")}

    def build(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, rig: Rig) -> None:
        slides = shape["direction"] == "slide"
        _base_joint(
            spec,
            rig,
            name=_SLIP,
            type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
            axis=[1, 0, 0] if slides else [0, 0, 1],
        )

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Feet(1 / amplitude, shape, plant)


class _Feet(Law):
    def __init__(self, friction: float, shape: Shape, plant: Plant) -> None:
        self._friction, self._shape, self._dof = friction, shape, plant.dof(_SLIP)
        self._bristles = Bristles(shape["bend"], friction, shape["damping_time_s"], plant.timestep)

    def act(self, torque: Array, state: StepState) -> None:
        speed, more = state.speeds[:, self._dof], self._shape["static_over_sliding"] - 1
        slow = np.exp(-np.abs(speed) / self._shape["stribeck_per_s"])
        torque[:, self._dof] += self._bristles.torque(speed, self._friction * (1 + more * slow))


def _base_joint(spec: mujoco.MjSpec, rig: Rig, **of: Any) -> None:
    """Add a joint to the base body."""
    free = mujoco.mjtLimited.mjLIMITED_FALSE
    spec.body(rig.base).add_joint(
        **({"damping": linear(0), "stiffness": linear(0), "armature": 0, "limited": free} | of)
    )


def _inertia_about_foot(rig: Rig) -> float:
    """Kg m^2 of the whole rig about its foot, roughly."""
    model = mujoco.MjModel.from_xml_string(rig.xml)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return float((model.body_mass * (data.xipos**2).sum(1)).sum())
