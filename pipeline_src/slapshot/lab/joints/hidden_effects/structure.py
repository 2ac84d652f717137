"""Hidden effects of the structure: masses, springs, backlash and joint zeros."""

from functools import cache
from itertools import product

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.lab.joints.execution import FLEX
from slapshot.lab.joints.hidden_effect import (
    Bounds,
    HiddenEffect,
    Law,
    NominalMotion,
    Plant,
    Shape,
    StepState,
    draw_joint,
    draw_sign,
)
from slapshot.lab.joints.rig import Rig

_STOP = 1000.0  # rad/s, of a link against the ends of its gap
_STEEPEST = 0.5  # rad a step: how fast a spring may make a joint swing


class _Geared(HiddenEffect):
    def fits(self, rig: Rig) -> bool:
        return rig.drive != "mocap"


class JointElasticity(_Geared):
    """Elastic gear: the servo acts on the rotor; link and encoder follow behind a spring."""

    name = "joint_elasticity"
    unit, amplitude = "rad/(N m)", "compliance of the spring"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"joint": draw_joint(nominal.rig, rng), "damping_ratio": float(rng.uniform(0.1, 0.3))}

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        force = nominal.force(nominal.rig.joints.index(shape["joint"]))
        minimum = (nominal.rig.clock.step / _STEEPEST) ** 2 / _between_inertia(nominal.rig, shape["joint"])
        return Bounds(max(3e-3 / force, minimum), minimum, max(0.5 / force, 2 * minimum))

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"stiffness": (1 / amplitude, "N m/rad")}

    def build(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, rig: Rig) -> None:
        inertia = _between_inertia(rig, shape["joint"])
        flex = _split(spec, shape["joint"])
        flex.stiffness = linear(1 / amplitude)
        flex.damping = linear(2 * shape["damping_ratio"] * np.sqrt(inertia / amplitude))


class Backlash(_Geared):
    """Backlash: link and encoder move freely against the rotor between two stops."""

    name = "backlash"
    unit, amplitude = "rad", "gap from end to end"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {
            "joint": draw_joint(nominal.rig, rng),
            "damping_ratio": float(rng.uniform(0.3, 0.8)),
            "drag_share": float(rng.uniform(0.05, 0.2)),  # of the joint's damping
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(3e-3, 0.0, 0.3)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"gap": (amplitude, "rad")}

    def build(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, rig: Rig) -> None:
        flex = _split(spec, shape["joint"])
        flex.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        flex.range = [-amplitude / 2, amplitude / 2]
        flex.solref_limit = [-(_STOP**2), -2 * shape["damping_ratio"] * _STOP]
        flex.solimp_limit = [0.95, 0.99, 1e-4, 0.5, 2]
        flex.damping = linear(shape["drag_share"] * rig.damping[rig.joints.index(shape["joint"])])


def linear(coefficient: float) -> list[float]:
    """Coefficients of a polynomial, as joints have them."""
    return [coefficient, 0, 0]


def _split(spec: mujoco.MjSpec, name: str) -> mujoco.MjsJoint:
    """A second joint about the axis of the first one, which keeps rotor, damping and actuator."""
    joint = spec.joint(name)
    return joint.parent.add_joint(
        name=FLEX + name,
        type=joint.type,
        axis=joint.axis,
        pos=joint.pos,
        limited=mujoco.mjtLimited.mjLIMITED_FALSE,
        armature=0,
        damping=linear(0),
    )


@cache
def _between_inertia(rig: Rig, joint: str) -> float:
    """Kg m^2, the least with which rotor and link swing against each other in the poses of a position."""
    spec = mujoco.MjSpec.from_string(rig.xml)
    _split(spec, joint)
    model = spec.compile()
    data, column = mujoco.MjData(model), model.joint(FLEX + joint).dofadr[0]
    push, moves = np.eye(model.nv)[column : column + 1], np.empty((1, model.nv))
    found = []
    for corner in product(*rig.centre):
        data.qpos[[model.joint(name).qposadr[0] for name in rig.joints]] = corner
        mujoco.mj_forward(model, data)
        mujoco.mj_solveM(model, data, moves, push)
        found.append(1 / moves[0, column])
    return float(min(found))


class Armature(HiddenEffect):
    """Error of the rotor inertia."""

    name = "armature"
    unit, amplitude = "kg m^2", "size of the difference, reflected through the gear"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"joint": draw_joint(nominal.rig, rng), "sign": draw_sign(rng)}

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        modelled = nominal.rig.armature[nominal.rig.joints.index(shape["joint"])]
        return Bounds(0.1 * modelled, 0.0, 0.9 * modelled if shape["sign"] < 0 else 20 * modelled)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"difference": (shape["sign"] * amplitude, "kg m^2")}

    def build(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, rig: Rig) -> None:
        spec.joint(shape["joint"]).armature += shape["sign"] * amplitude


class LinkMass(HiddenEffect):
    """Error of a link's mass; its inertia is off by another factor.

    Gravity compensation still uses the nominal mass.
    """

    name = "link_mass"
    unit, amplitude = "1", "size of the logarithm of true over believed mass"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        # The first link of an upright axis turns on the spot.
        links = [
            b for b, j in zip(nominal.rig.links, nominal.rig.joints, strict=True) if _weighs(nominal.rig, j)
        ]
        return {
            "body": str(rng.choice(links)),
            "sign": draw_sign(rng),
            "inertia_power": float(rng.uniform(0.7, 1.3)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.1, 0.0, 1.8)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"mass_factor": (float(np.exp(shape["sign"] * amplitude)), "1")}

    def tune(self, amplitude: float, shape: Shape, model: mujoco.MjModel, rig: Rig) -> None:
        body, log_factor = model.body(shape["body"]).id, shape["sign"] * amplitude
        model.body_mass[body] *= np.exp(log_factor)
        model.body_inertia[body] *= np.exp(shape["inertia_power"] * log_factor)
        model.body_gravcomp[body] /= np.exp(log_factor)


def _weighs(rig: Rig, joint: str) -> bool:
    return not rig.loaded or joint in rig.loaded


class Payload(HiddenEffect):
    """An unmodelled payload at the tip; gravity compensation does not include it."""

    name = "payload"
    unit, amplitude = "kg", "mass"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        away = rng.normal(size=3)
        return {
            "body": nominal.rig.tip[0],
            "from_tip_m": (away / np.linalg.norm(away) * rng.uniform(0.0, 0.06)).tolist(),
            "radius_m": float(rng.uniform(0.02, 0.05)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.02, 0.0, 15.0)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"mass": (amplitude, "kg")}

    def build(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, rig: Rig) -> None:
        body, position = rig.tip
        radius = shape["radius_m"]
        load = spec.body(body).add_body(name="lab_payload", pos=np.add(position, shape["from_tip_m"]))
        load.mass, load.ipos = amplitude, [0, 0, 0]
        load.inertia = np.full(3, 0.4 * amplitude * radius**2)
        load.explicitinertial = True


class JointOffset(HiddenEffect):
    """Zero offset of an encoder that servo and recording share.

    It is observable through gravity only: not at a vertical axis, nor with gravity compensation by the same
    encoders and stiff servos.
    """

    name = "joint_offset"
    unit, amplitude = "rad", "size of the offset"

    def fits(self, rig: Rig) -> bool:
        return bool(rig.loaded)

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"joint": draw_joint(nominal.rig, rng, nominal.rig.loaded), "sign": draw_sign(rng)}

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.02, 0.0, 1.0)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"offset": (shape["sign"] * amplitude, "rad")}  # read less true

    def build(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, rig: Rig) -> None:
        spec.joint(shape["joint"]).ref += shape["sign"] * amplitude


class Spring(HiddenEffect):
    """A hose or cable bundle along a joint: a hardening spring about a rest angle."""

    name = "spring"
    unit, amplitude = "N m/rad", "stiffness at the rest angle"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        joint = draw_joint(nominal.rig, rng)
        angles = nominal.positions[..., nominal.rig.joints.index(joint)]
        middle, spread = angles.mean(), angles.std()
        return {
            "joint": joint,
            "rest_rad": float(middle + rng.uniform(-1.5, 1.5) * spread),
            "stiffens_at_rad": float(spread * rng.uniform(2, 5)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        joint = nominal.rig.joints.index(shape["joint"])
        stiffness = nominal.force(joint) / nominal.positions[..., joint].std()
        return Bounds(0.03 * stiffness, 0.0, 3 * stiffness)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"stiffness": (amplitude, "N m/rad"), "rest": (shape["rest_rad"], "rad")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Hose(amplitude, shape, plant)


class _Hose(Law):
    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        self._stiffness, self._shape = amplitude, shape
        self._joint, self._dof = plant.rig.joints.index(shape["joint"]), plant.dof(shape["joint"])

    def act(self, torque: Array, state: StepState) -> None:
        bend = state.position[:, self._joint] - self._shape["rest_rad"]
        torque[:, self._dof] -= self._stiffness * bend * (1 + (bend / self._shape["stiffens_at_rad"]) ** 2)
