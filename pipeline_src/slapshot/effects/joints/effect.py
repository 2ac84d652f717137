"""Base class of effects on joints and bodies.

An effect acts on a part of the model (a joint, body, actuator, channel, or the whole rig) through one or more
of
five hooks: parameters of the compiled model (`edit`), controls (`control`), generalised forces (`force`),
observations (`observe`), or the model's structure (`restructure`). It overrides the hooks that it uses.
If an effect can be modelled in several ways, each is a variant with the same name.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from slapshot.arrays import Array


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect.

    Attributes:
        name: within the effect.
        unit: "1" for none.
        scale: standard deviation of the prior about `start`; the size of a large value.
        start: initial value of fits and centre of the prior; 0 for a size, where the effect is absent.
        low: physical bound.
        high: physical bound.
        probe: deviation from `start` for finite differences; small where the effect is linear in it.
    """

    name: str
    unit: str
    scale: float
    start: float = 0.0
    low: float = -np.inf
    high: float = np.inf
    probe: float = 0.0


@dataclass(frozen=True)
class Joint:
    """A hinge or slide.

    Attributes:
        name: in the model.
        q: index in qpos.
        v: index in qvel.
        unit: of its torque or force.
        actuators: indices of those that drive it.
        torque: rms generalised force along the recorded motion, N m or N.
        largest: largest force of each of its actuators along the recorded motion, before the gear.
        speed: rms speed, rad/s or m/s.
        travel: standard deviation of its position, rad or m.
        middle: mean position.
        inertia: mean of its diagonal entry of the mass matrix.
    """

    name: str
    q: int
    v: int
    unit: str
    actuators: tuple[int, ...]
    torque: float
    largest: tuple[float, ...]
    speed: float
    travel: float
    middle: float
    inertia: float

    @property
    def angle_unit(self) -> str:
        """Rad or m."""
        return "rad" if self.unit == "N m" else "m"

    @property
    def step_speed(self) -> float:
        """Width of the regularised sign of the velocity, rad/s or m/s."""
        return 0.02 * self.speed

    def note(self, law: str) -> str:
        """Instruction for adding a law of the joint's position q and velocity v to a simulation."""
        return (
            f"Apply as qfrc_applied at joint {self.name}: {law} (in {self.unit}; position q in "
            f"{self.angle_unit}, velocity v in {self.angle_unit}/s)."
        )


@dataclass(frozen=True)
class SensedChannel:
    """A column of the observations: its channel, quantity, joint (None for sites and bodies), and clock."""

    column: int
    channel: str
    quantity: str
    joint: str | None
    clock: str


@dataclass(frozen=True)
class RigMotion:
    """A nominal model and scales of its recorded motion, for which effects are instantiated.

    Attributes:
        model: nominal, compiled.
        joints: hinges and slides.
        free_bodies: (body index, first index in qvel) of bodies with a free joint.
        sensed: observations.
        interval: s between samples.
        episodes: number of them.
        speed: rms speed of free bodies in m/s, 0 without.
    """

    model: mujoco.MjModel
    joints: tuple[Joint, ...]
    free_bodies: tuple[tuple[int, int], ...]
    sensed: tuple[SensedChannel, ...]
    interval: float
    episodes: int
    speed: float = 0.0

    @property
    def flying(self) -> tuple[tuple[int, int], ...]:
        """Free bodies on which air may act; none where no reading shows that any moves along."""
        return self.free_bodies if self.speed > 0 else ()


@dataclass(frozen=True)
class State:
    """n states at one moment of a simulation.

    Attributes:
        q: (n, nq), v: (n, nv).
        torque: (n, nv) actuator force on each degree of freedom.
        time: (n,) s from the episode's start.
        order: (n,) normalised position of the episode in the session, -1/2 to 1/2.
    """

    q: Array
    v: Array
    torque: Array
    time: Array
    order: Array


@dataclass(frozen=True)
class Observed:
    """Observations of the model along a trajectory.

    Attributes:
        y: (n, ny) without the effect.
        rate: (n, ny) its derivative in 1/s.
        second_rate: (n, ny) its second derivative in 1/s².
        order: (n,) normalised position of the episode in the session, -1/2 to 1/2.
        third_rate: (n, ny) its third derivative in 1/s³; None where it is neglected.
    """

    y: Array
    rate: Array
    second_rate: Array
    order: Array
    third_rate: Array | None = None


class JointEffect:
    """An effect that a model lacks, at one part of it.

    Attributes:
        name: slug; in verdicts and rig files.
        physics: description of the physics, in two lines.
        source: reference for its law.
        phrase: phrase for reports, such as "viscous friction at {part}".
        part: name in the model; "" for the whole rig.
        variant: variant of the model, if there are several.
        parameters: with priors for this part.
        many_forms: whether it has so many instances that together they would explain noise.
        empirical: whether its law is empirical and holds to about ten per cent.
        friction: whether it is a friction law, which is inaccurate near rest.
        hidden_state: whether it adds states to the model, so that a first-order perturbation is not valid.
        both_signs: whether a value of opposite sign may fit nearly as well, so that fits start from both.
    """

    name: ClassVar[str]
    physics: ClassVar[str]
    source: ClassVar[str]
    phrase: ClassVar[str]
    hidden_state: ClassVar[bool] = False
    many_forms: ClassVar[bool] = False
    empirical: bool = False
    friction: ClassVar[bool] = False
    both_signs: ClassVar[bool] = False

    def __init__(self, part: str, parameters: Sequence[Parameter], variant: str = "") -> None:
        self.part, self.parameters, self.variant = part, tuple(parameters), variant

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["JointEffect"]:
        """One instance for every possible part and variant."""
        raise NotImplementedError

    def on(self, rig: RigMotion) -> "JointEffect":
        """The same effect on another rig that has the same part, such as one with a joint more.

        Raises:
            KeyError: it has no place there.
        """
        return {effect.key: effect for effect in type(self).instances(rig)}[self.key]

    @property
    def key(self) -> str:
        """`name@part`, and the variant."""
        key = f"{self.name}@{self.part}" if self.part else self.name
        return f"{key} ({self.variant})" if self.variant else key

    @property
    def probe_values(self) -> tuple[tuple[float, ...], ...]:
        """Values for finite differences: each gives a column, (F(value) - F(start)) / probe."""
        perturbations = []
        for i, parameter in enumerate(self.parameters):
            if parameter.probe:
                values = [p.start for p in self.parameters]
                values[i] = parameter.start + parameter.probe
                perturbations.append(tuple(values))
        return tuple(perturbations)

    def describes(self, values: Array) -> bool:
        """Whether there is such an effect with these values: not where all its non-negative sizes are 0."""
        sizes = [
            (value, p) for value, p in zip(values, self.parameters, strict=True) if p.low == p.start == 0
        ]
        return not sizes or any(value > 1e-9 * p.scale for value, p in sizes)

    @property
    def on_joint(self) -> str:
        """Name of the joint on which its law acts."""
        return self.part

    @property
    def misreads(self) -> bool:
        """Whether it is an error of readings, which is a multiple of them or shifts them."""
        return overrides(self, "observe")

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Change parameters of a compiled model in place."""

    def control(self, u: Array, step: float, values: Array) -> Array:
        """Controls (steps, nu) of an episode, at steps of `step` s."""
        return u

    def force(self, state: State, values: Array) -> Array | None:
        """Generalised force, (n, nv)."""
        return None

    def observe(self, seen: Observed, values: Array) -> Array | None:
        """Contribution to the observations, (n, ny)."""
        return None

    def soft_limit(self, model: mujoco.MjModel, force: Array, values: Array) -> tuple[int, Array]:
        """Soft onset of an actuator limit, in addition to the hard limit.

        Args:
            model: nominal.
            force: (n, nu) of its actuators, before gears.
            values: of the effect.

        Returns:
            Index of the joint in qvel, and (n, k) torque, N m or N, for k sharpnesses.
        """
        raise NotImplementedError

    def deviations(self, state: State, values: Array) -> Array | None:
        """Forces by which what is real may deviate from this law, each as large as the law itself.

        Args:
            state: n states.
            values: of the effect.

        Returns:
            (n, nv, k) N m or N; None for none but those of every empirical law.
        """
        return None

    def note(self, values: Array) -> str:
        """Instruction for adding what MJCF cannot represent (`control`, `force`, `observe`) to a simulation.

        Formulas have their values in SI units; "" if the model represents the effect.
        """
        return ""

    def same_as(self, values: Array) -> str:
        """Equivalent description of the law with these values; "" for none."""
        return ""

    @property
    def fastest(self) -> float:
        """Fastest mode that `restructure` adds, rad/s, which the time step must resolve."""
        return 0.0

    @property
    def added_joint(self) -> str | None:
        """Name of the first joint that `restructure` adds."""
        return None

    def restructure(self, spec: mujoco.MjSpec) -> mujoco.MjSpec:
        """The model with added bodies or joints, whose parameters `edit` sets; `spec` may be modified."""
        return spec


def overrides(effect: JointEffect, method: str) -> bool:
    """Whether an effect overrides a hook."""
    return getattr(type(effect), method) is not getattr(JointEffect, method)


def servo(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator has position feedback from its joint."""
    return (
        model.actuator_biastype[actuator] == int(mujoco.mjtBias.mjBIAS_AFFINE)
        and model.actuator_biasprm[actuator, 1] != 0
    )


def on_joint(joint: Joint, torque: Array, nv: int) -> Array:
    """A torque on one joint as a generalised force, (n, nv)."""
    force = np.zeros((len(torque), nv))
    force[:, joint.v] = torque
    return force
