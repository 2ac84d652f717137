"""Hidden joint friction, by bristles that bend before they slip.

Dry friction is LuGre's (Canudas de Wit, Olsson, Astrom, Lischinsky 1995, "A new model for control of systems
with friction"): bristles of deflection z with

    dz/dt = v - s0 |v| z / g(v),    torque = -(s0 z + s1 dz/dt)

so that the torque does not jump with the sign of the speed: in stiction the joint moves slightly. g is the
level
of sliding friction, in which the effects differ.
"""

from collections.abc import Callable

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
    draw_joint,
    draw_sign,
)
from slapshot.lab.joints.rig import Rig

_LOAD_TIME = 0.004  # s, over which a load presses bristles together
_LEAST_LEVEL = 1e-6  # N m, of friction where nothing presses


class Bristles:
    """LuGre's bristles of all episodes.

    Args:
        bend: rad (or m) by which bristles bend before they slip at a friction of `scale`.
        scale: N m (or N).
        damping_time: s, s1 over s0.
        timestep: s.
    """

    def __init__(self, bend: float, scale: float, damping_time: float, timestep: float) -> None:
        self._stiffness, self._damping_time, self._timestep = scale / bend, damping_time, timestep
        self._deflection: Array | float = 0.0

    def torque(self, speed: Array, level: Array | float) -> Array:
        """After another step at `speed` (episodes,) with a sliding friction of `level`."""
        rate = np.abs(speed) * self._stiffness / level
        slipping = np.sign(speed) * level / self._stiffness
        # Exact for constant speed, since bristles are too stiff for explicit steps.
        decay = np.exp(-rate * self._timestep)
        gone = np.where(rate * self._timestep > 1e-9, slipping * (1 - decay), speed * self._timestep)
        self._deflection = self._deflection * decay + gone
        change = speed - rate * self._deflection
        return -self._stiffness * (self._deflection + self._damping_time * change)


class DryLaw(Law):
    """Bristles in a joint; `level` makes their sliding friction of speed (episodes,) and load."""

    def __init__(
        self,
        plant: Plant,
        shape: Shape,
        scale: float,
        level: Callable[[Array, Array], Array | float],
    ) -> None:
        self._bristles = Bristles(shape["bend_rad"], scale, shape["damping_time_s"], plant.timestep)
        self._level, self._dof = level, plant.dof(shape["joint"])
        self._joint = plant.rig.joints.index(shape["joint"])

    def act(self, torque: Array, state: StepState) -> None:
        speed = state.speeds[:, self._dof]
        torque[:, self._dof] += self._bristles.torque(speed, self._level(speed, state.load[:, self._joint]))


def _draw_bristles(nominal: NominalMotion, rng: np.random.Generator) -> Shape:
    return {
        "joint": draw_joint(nominal.rig, rng),
        "bend_rad": float(np.exp(rng.uniform(*np.log((3e-4, 1e-3))))),
        "damping_time_s": float(rng.uniform(1e-3, 3e-3)),
    }


def _force_bounds(
    nominal: NominalMotion, shape: Shape, typical: float = 0.05, maximum: float = 3.0
) -> Bounds:
    """Shares of what the joint's actuator does."""
    force = nominal.force(nominal.rig.joints.index(shape["joint"]))
    return Bounds(typical * force, 0.0, maximum * force)


class ViscousFriction(HiddenEffect):
    """Viscous friction of a film that responds with a lag and is shear-thinning.

    A negative sign reduces the rig's own damping.
    """

    name = "viscous_friction"
    unit, amplitude = "N m s/rad", "torque over speed of a slow joint"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        joint = draw_joint(nominal.rig, rng)
        speed = nominal.speed(nominal.rig.joints.index(joint))
        return {
            "joint": joint,
            "sign": float(rng.choice((-1.0, 1.0), p=(0.25, 0.75))),
            "answer_s": float(rng.uniform(5e-4, 2e-3)),
            "thins_at_rad_s": speed * float(rng.uniform(2, 6)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        joint = nominal.rig.joints.index(shape["joint"])
        if shape["sign"] < 0:
            damping = nominal.rig.damping[joint]
            return Bounds(0.3 * damping, 0.0, 0.9 * damping)
        slope = nominal.force(joint) / nominal.speed(joint)
        return Bounds(0.05 * slope, 0.0, 5 * slope)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"damping": (shape["sign"] * amplitude, self.unit)}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Film(amplitude, shape, plant)


class _Film(Law):
    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        self._size, self._dof = shape["sign"] * amplitude, plant.dof(shape["joint"])
        self._thins, self._torque = shape["thins_at_rad_s"], 0.0
        self._share = 1 - np.exp(-plant.timestep / shape["answer_s"])

    def act(self, torque: Array, state: StepState) -> None:
        speed = state.speeds[:, self._dof]
        wanted = -self._size * speed / np.sqrt(1 + (speed / self._thins) ** 2)
        self._torque = self._torque + self._share * (wanted - self._torque)
        torque[:, self._dof] += self._torque


class CoulombFriction(HiddenEffect):
    """Coulomb friction once the bristles slip."""

    name = "coulomb_friction"
    unit, amplitude = "N m", "sliding friction"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return _draw_bristles(nominal, rng)

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return _force_bounds(nominal, shape)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"friction": (amplitude, "N m")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return DryLaw(plant, shape, amplitude, lambda speed, load: amplitude)


class StribeckFriction(HiddenEffect):
    """Friction that is higher at low speed (Stribeck)."""

    name = "stribeck_friction"
    unit, amplitude = "N m", "sliding friction of a fast joint"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        shape = _draw_bristles(nominal, rng)
        speed = nominal.speed(nominal.rig.joints.index(shape["joint"]))
        return {
            **shape,
            "static_over_sliding": float(rng.uniform(1.8, 3.5)),
            "stribeck_rad_s": speed * float(rng.uniform(0.1, 0.4)),
            "power": float(rng.uniform(0.7, 2.0)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return _force_bounds(nominal, shape)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {
            "sliding": (amplitude, "N m"),
            "static": (amplitude * shape["static_over_sliding"], "N m"),
            "speed": (shape["stribeck_rad_s"], "rad/s"),
        }

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        more, at, power = shape["static_over_sliding"] - 1, shape["stribeck_rad_s"], shape["power"]
        return DryLaw(
            plant,
            shape,
            amplitude,
            lambda speed, load: amplitude * (1 + more * np.exp(-((np.abs(speed) / at) ** power))),
        )


class LoadFriction(HiddenEffect):
    """Friction in proportion to the transmitted torque."""

    name = "load_friction"
    unit, amplitude = "1", "sliding friction over the torque that is transmitted"

    def fits(self, rig: Rig) -> bool:
        return rig.drive != "mocap"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        shape = _draw_bristles(nominal, rng)
        return {**shape, "scale_n_m": nominal.force(nominal.rig.joints.index(shape["joint"]))}

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.05, 0.0, 0.9)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"friction_per_load": (amplitude, "1")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        share, pressed = 1 - np.exp(-plant.timestep / _LOAD_TIME), np.zeros(len(plant.session))

        def level(speed: Array, load: Array) -> Array:
            pressed[:] += share * (np.abs(load) - pressed)
            return amplitude * pressed + _LEAST_LEVEL

        return DryLaw(plant, shape, amplitude * shape["scale_n_m"], level)


class DirectionFriction(HiddenEffect):
    """Friction that depends on direction, as with worn teeth: a (1 + d) forwards and a (1 - d) backwards."""

    name = "direction_friction"
    unit, amplitude = "N m", "mean of the sliding friction in both directions"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {**_draw_bristles(nominal, rng), "difference": draw_sign(rng) * float(rng.uniform(0.5, 0.95))}

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return _force_bounds(nominal, shape)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {
            "forwards": (amplitude * (1 + shape["difference"]), "N m"),
            "backwards": (amplitude * (1 - shape["difference"]), "N m"),
        }

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return DryLaw(
            plant,
            shape,
            amplitude,
            lambda speed, load: amplitude * (1 + shape["difference"] * np.sign(speed)),
        )


class FrictionDrift(HiddenEffect):
    """Warm-up: the friction of cold grease falls over the session."""

    name = "friction_drift"
    unit, amplitude = "N m", "friction in the first episode at the joint's usual speed"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        joint = draw_joint(nominal.rig, rng)
        speed = nominal.speed(nominal.rig.joints.index(joint))
        return {
            "joint": joint,
            "warm_share": float(rng.uniform(0.0, 0.25)),
            "warms_in": float(rng.uniform(0.15, 0.5)),  # of the session
            "viscous_share": float(rng.uniform(0.2, 0.8)),
            "usual_rad_s": speed,
            "turns_at_rad_s": speed * float(rng.uniform(0.05, 0.2)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return _force_bounds(nominal, shape)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"first": (amplitude, "N m"), "warm": (amplitude * shape["warm_share"], "N m")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        warm = shape["warm_share"]
        level = amplitude * (warm + (1 - warm) * np.exp(-plant.session / shape["warms_in"]))
        return _Grease(level, shape, plant)


class _Grease(Law):
    def __init__(self, level: Array, shape: Shape, plant: Plant) -> None:
        self._level, self._shape, self._dof = level, shape, plant.dof(shape["joint"])

    def act(self, torque: Array, state: StepState) -> None:
        speed, shape = state.speeds[:, self._dof], self._shape
        dry = np.tanh(speed / shape["turns_at_rad_s"])
        viscous = speed / shape["usual_rad_s"]
        share = shape["viscous_share"]
        torque[:, self._dof] -= self._level * ((1 - share) * dry + share * viscous)
