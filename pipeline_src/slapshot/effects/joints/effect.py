"""The face of an effect on a model of joints and bodies.

An effect sits on a part of the model (a joint, body, actuator, channel, or the whole rig) and changes the
model at one or more of five places: numbers of the compiled model (`edit`), controls (`control`), generalised
forces (`force`), observations (`observe`), or the model's structure (`restructure`). It overrides what it
changes.
Where an effect can be built in more than one way, each is a variant; all bear one name.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from slapshot.arrays import Array


@dataclass(frozen=True)
class Parameter:
    """A number of an effect.

    Attributes:
        name: within the effect.
        unit: "1" for none.
        scale: standard deviation of the prior about `start`; of what one would call large.
        start: where a fit begins and where the prior is centred: for a size 0, where the effect is absent.
        low, high: what is physically possible.
        probe: value at which a first look is taken; small where the effect is linear in it.
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
        q, v: indices in qpos and qvel.
        unit: of its torque or force.
        actuators: indices of those that drive it.
        torque: rms torque that moves it along the recorded motion, N m or N.
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
        """Width of the smoothed sign of the velocity, rad/s or m/s."""
        return 0.02 * self.speed

    def note(self, law: str) -> str:
        """How to add a law of the joint's position q and velocity v to a simulation."""
        return (
            f"Apply as qfrc_applied at joint {self.name}: {law} (in {self.unit}; position q in "
            f"{self.angle_unit}, velocity v in {self.angle_unit}/s)."
        )


@dataclass(frozen=True)
class Sensed:
    """A column of the observations: its channel, quantity, and joint (None for sites and bodies)."""

    column: int
    channel: str
    quantity: str
    joint: str | None


@dataclass(frozen=True)
class Situation:
    """What instances of effects are made for: a model and how it was moved.

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
    sensed: tuple[Sensed, ...]
    interval: float
    episodes: int
    speed: float = 0.0


@dataclass(frozen=True)
class State:
    """n states at one moment of a simulation.

    Attributes:
        q: (n, nq), v: (n, nv).
        torque: (n, nv) actuator force on each degree of freedom.
        time: (n,) s from the episode's start.
        order: (n,) place in the session, -1/2 to 1/2.
    """

    q: Array
    v: Array
    torque: Array
    time: Array
    order: Array


@dataclass(frozen=True)
class Observed:
    """What the model observes along a path.

    Attributes:
        y: (n, ny) without the effect.
        rate: (n, ny) its derivative in 1/s.
        bend: (n, ny) its second derivative in 1/s².
        order: (n,) place in the session.
    """

    y: Array
    rate: Array
    bend: Array
    order: Array


class JointEffect:
    """Physics that a model leaves out, at one part of it.

    Attributes:
        name: slug; in verdicts and rig files.
        physics: what it is, in two lines.
        source: where its law is described.
        phrase: said of a part, such as "viscous friction at {part}".
        part: name in the model; "" for the whole rig.
        variant: how it is built, where there is a choice.
        parameters: with priors for this part.
        many_forms: whether it is looked at in so many forms that together they would explain noise.
        empirical: whether its law is one of experience, which holds to some ten per cent.
        friction: whether it is one; of that near rest no such law tells well.
        hidden_state: whether it has a state of its own, so that a first-order look cannot model it.
        both_signs: whether a value of the other sign may fit nearly as well, so that fits begin at both.
    """

    name: ClassVar[str]
    physics: ClassVar[str]
    source: ClassVar[str]
    phrase: ClassVar[str]
    hidden_state: ClassVar[bool] = False
    many_forms: ClassVar[bool] = False
    empirical: ClassVar[bool] = False
    friction: ClassVar[bool] = False
    both_signs: ClassVar[bool] = False

    def __init__(self, part: str, parameters: Sequence[Parameter], variant: str = "") -> None:
        self.part, self.parameters, self.variant = part, tuple(parameters), variant

    @classmethod
    def instances(cls, rig: Situation) -> Iterator["JointEffect"]:
        """One for every part that the effect can sit on, and variant."""
        raise NotImplementedError

    def on(self, rig: Situation) -> "JointEffect":
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
    def initial_values(self) -> tuple[tuple[float, ...], ...]:
        """Values at which a first look is taken: each gives a column, (F(value) - F(start)) / probe."""
        looks = []
        for i, parameter in enumerate(self.parameters):
            if parameter.probe:
                values = [p.start for p in self.parameters]
                values[i] = parameter.start + parameter.probe
                looks.append(tuple(values))
        return tuple(looks)

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Change numbers of a compiled model in place."""

    def control(self, u: Array, step: float, values: Array) -> Array:
        """Controls (steps, nu) of an episode, at steps of `step` s."""
        return u

    def force(self, state: State, values: Array) -> Array | None:
        """Generalised force, (n, nv)."""
        return None

    def observe(self, seen: Observed, values: Array) -> Array | None:
        """What is added to the observations, (n, ny)."""
        return None

    def knees(self, model: mujoco.MjModel, force: Array, values: Array) -> tuple[int, Array]:
        """What a limit of an actuator does before it is reached, beside what it does at it.

        Args:
            model: nominal.
            force: (n, nu) of its actuators, before gears.
            values: of the effect.

        Returns:
            Index of the joint in qvel, and (n, k) torque, N m or N, in k shapes that it may have.
        """
        raise NotImplementedError

    def note(self, values: Array) -> str:
        """How to add to a simulation what MJCF cannot hold (`control`, `force`, `observe`), in words.

        Formulas have their values in SI units; "" where the model holds all.
        """
        return ""

    def same_as(self, values: Array) -> str:
        """What else the law with these values is called; "" for nothing."""
        return ""

    @property
    def fastest(self) -> float:
        """Rad/s of what `restructure` adds: a simulation must have steps that are short against it."""
        return 0.0

    @property
    def added_joint(self) -> str | None:
        """Name of the first joint that `restructure` adds."""
        return None

    def restructure(self, spec: mujoco.MjSpec) -> mujoco.MjSpec:
        """The model with more bodies or joints, whose numbers `edit` sets; `spec` may be changed."""
        return spec


def overrides(effect: JointEffect, method: str) -> bool:
    """Whether an effect changes this place."""
    return getattr(type(effect), method) is not getattr(JointEffect, method)


def servo(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator feeds the position of its joint back."""
    return (
        model.actuator_biastype[actuator] == int(mujoco.mjtBias.mjBIAS_AFFINE)
        and model.actuator_biasprm[actuator, 1] != 0
    )


def on_joint(joint: Joint, torque: Array, nv: int) -> Array:
    """A torque on one joint as a generalised force, (n, nv)."""
    force = np.zeros((len(torque), nv))
    force[:, joint.v] = torque
    return force
