"""Small rigs, how they are moved, and what a hypothesis makes of that: for tests of effects on joints."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import mujoco
import numpy as np
from slapshot.arrays import Array
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.rig_motion import rig_motion
from slapshot.diagnosis.model.segments import Segments
from slapshot.effects.joints.catalogue import instances
from slapshot.effects.joints.effect import JointEffect, Observed, RigMotion, overrides
from slapshot.recordings.channels import Channel

_OPTIONS = '<option><flag contact="disable"/></option>'
Commands = Callable[[Array], Array | Sequence[Array]]


def reads(quantity: Literal["position", "velocity", "torque"] = "position", **of: str) -> Channel:
    """An observation of a joint (of a hinge, but for another unit), or the x of a site or body."""
    unit = of.pop("unit", {"position": "rad", "velocity": "rad/s", "torque": "N m"}[quantity])
    if "joint" not in of:
        return Channel(
            clock="c", role="observation", quantity=quantity, unit=unit.replace("rad", "m"),
            component="x", **of,
        )  # fmt: skip
    return Channel(clock="c", role="observation", quantity=quantity, unit=unit, **of)


def tells(actuator: str) -> Channel:
    return Channel(clock="c", role="control", quantity="command", unit="1", actuator=actuator)


@dataclass(frozen=True)
class RigSimulator:
    """A rig, and how it is moved: all episodes begin in one state and have the same commands.

    Attributes:
        rig: nominal.
        channels: that it is bound to.
        start: (nq + nv + na,) first state.
        commands: controls (nu arrays) at times in s.
        seconds: length of an episode.
        interval: s between nodes, of two steps each.
        episodes: number of them.
    """

    rig: Rig
    channels: dict[str, Channel]
    start: Array
    commands: Commands = lambda t: []
    seconds: float = 0.2
    interval: float = 0.005
    episodes: int = 5

    @cached_property
    def segments(self) -> Segments:
        """One for each episode; each step has the command at its middle."""
        length, ny, substeps = round(self.seconds / self.interval), len(self.rig.observations), 2
        steps = (np.arange(length * substeps) + 0.5) * self.interval / substeps
        told = np.array(self.commands(steps), float).reshape(self.rig.model.nu, len(steps)).T
        count, shape = self.episodes, (self.episodes, length)
        return Segments(
            interval=self.interval,
            substeps=substeps,
            y=np.full((*shape, ny), np.nan),
            shift=np.zeros((*shape, ny)),
            shift_square=np.zeros((*shape, ny)),
            inside=np.ones(shape, bool),
            time=np.tile(np.arange(length) * self.interval, (count, 1)),
            episode=np.arange(count),
            first=np.zeros(count, int),
            order=np.linspace(-0.5, 0.5, count) if count > 1 else np.zeros(1),
            controls=(told,) * count,
            ids=np.arange(count),
            quantisation=np.zeros(ny),
        )

    @cached_property
    def nominal(self) -> "Motion":
        """Without effects."""
        return self.moved()

    @cached_property
    def rig_motion(self) -> RigMotion:
        """Of the nominal motion."""
        return rig_motion(self.rig, self.segments, self.nominal.x)

    @cached_property
    def effects(self) -> list[JointEffect]:
        """All instances."""
        return instances(self.rig_motion)

    def effect(self, name: str, part: str = "", variant: str = "") -> JointEffect:
        """The first instance of an effect at a part, in a variant whose name holds a text."""
        return next(
            e for e in self.effects if e.name == name and e.part == (part or e.part) and variant in e.variant
        )

    def moved(self, effect: JointEffect | None = None, *values: float) -> "Motion":
        """Motion with an effect, as the engine simulates it."""
        hypothesis = Hypothesis(self.rig, () if effect is None else (effect,))
        theta, s = np.array(values, float), self.segments
        model, control = hypothesis.compiled(theta, s.step), hypothesis.control(s, theta)
        simulator, state = Simulator(self.rig), np.tile(self.start, (self.episodes, 1))
        trajectory, seen, load = [], [], []
        for node in range(s.shape[1]):
            trajectory.append(state)
            state, y, torque = simulator.advance(
                hypothesis, theta, model, state, control[:, node], s.time[:, node], s.order
            )
            seen.append(y)
            load.append(torque)
        x, y = np.stack(trajectory, axis=1), np.stack(seen, axis=1)
        rate = np.gradient(y, s.interval, axis=1, edge_order=2)
        bend = np.gradient(rate, s.interval, axis=1, edge_order=2)
        jerk = np.gradient(bend, s.interval, axis=1, edge_order=2)
        *flat, third = (a.reshape(-1, y.shape[2]) for a in (y, rate, bend, jerk))
        added = hypothesis.observe(Observed(*flat, np.repeat(s.order, s.shape[1]), third), theta)
        return Motion(self, x, y + added.reshape(y.shape), np.stack(load, axis=1))


@dataclass(frozen=True)
class Motion:
    """What a hypothesis does at the nodes: states x, observations y, actuator torques; (episodes, L, n)."""

    bench: RigSimulator
    x: Array
    y: Array
    torque: Array

    @property
    def t(self) -> Array:
        """(L,) s."""
        return self.bench.segments.time[0]

    def q(self, i: int = 0) -> Array:
        """A position in the first episode."""
        return self.x[0, :, i]

    def v(self, i: int = 0) -> Array:
        """A velocity in the first episode."""
        return self.x[0, :, self.bench.rig.model.nq + i]


def bench(
    xml: str, channels: dict[str, Channel], start: Sequence[float] = (), commands: Commands = lambda t: [],
    **rest: float,
) -> RigSimulator:  # fmt: skip
    """A bench; without a start it begins at the model's reference, at rest."""
    rig = bind(mujoco.MjSpec.from_string(f"<mujoco>{_OPTIONS}{xml}</mujoco>"), channels)
    model = rig.model
    x = np.concatenate([model.qpos0, np.zeros(model.nv + model.na)])
    x[: len(start)] = start
    return RigSimulator(rig, channels, x, commands, **rest)


def arm() -> RigSimulator:
    """Two hinges with position servos, in a vertical plane."""
    return bench(
        """<worldbody><body name="upper"><joint name="shoulder" axis="0 1 0" damping=".2" frictionloss=".1"
            stiffness=".5" springref="-20"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>
          <body name="fore" pos=".3 0 0"><joint name="elbow" axis="0 1 0" damping=".1" armature=".01"/>
            <geom type="capsule" fromto="0 0 0 .25 0 0" size=".02"/><site name="tip" pos=".25 0 0"/>
          </body></body></worldbody>
        <actuator><position name="first" joint="shoulder" kp="60" kv="4"/>
          <position name="second" joint="elbow" kp="30" dampratio="1" forcerange="-8 6"/></actuator>""",
        {
            "u1": tells("first"),
            "u2": tells("second"),
            "q1": reads(joint="shoulder"),
            "q2": reads(joint="elbow"),
            "x": reads(site="tip"),
        },
        [0.2, -0.3],
        lambda t: [0.2 + 0.6 * np.sin(7 * t), -0.3 + 0.8 * np.sin(9 * t)],
    )


def pendulum() -> RigSimulator:
    """A hinge with a geared motor and another without a gear, and one that hangs from it."""
    return bench(
        """<worldbody><body pos="0 0 1"><joint name="axle" axis="0 1 0" damping=".05"/>
            <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02"/>
          <body name="bob" pos="0 0 -.4"><joint name="tail" axis="0 1 0" ref="20"/>
            <geom type="box" pos="0 0 -.1" size=".02 .03 .1"/>
            <body name="flange"><body name="tool" pos="0 0 -.2"><geom size=".02"/></body></body>
          </body></body></worldbody>
        <actuator><motor name="geared" joint="axle" gear="20"/><motor name="direct" joint="axle"/>
        </actuator>""",
        {
            "u1": tells("geared"),
            "u2": tells("direct"),
            "q": reads(joint="axle"),
            "v": reads("velocity", joint="axle"),
            "w": reads(joint="tail"),
        },
        [0.5],
        lambda t: [0.2 * np.sin(8 * t), 0.5 * np.sin(5 * t)],
    )


def slide() -> RigSimulator:
    """A cart with a velocity servo, and a lift with a rope and a recorded force; gravity is along -y."""
    return bench(
        """<option gravity="0 -9.81 0" integrator="implicitfast"/>
        <worldbody><body><joint name="rail" type="slide" axis="1 0 0" damping="2" frictionloss="1"
            stiffness="5"/><geom size=".05" mass="1.5"/><site name="cart" pos=".02 0 0"/></body>
          <body name="lift"><joint name="mast" type="slide" axis="0 1 0" damping="4"
            actuatorfrcrange="-40 40"/><geom type="box" size=".05 .05 .05" mass="1"/></body></worldbody>
        <tendon><fixed name="rope"><joint joint="mast" coef="1"/></fixed></tendon>
        <actuator><velocity name="belt" joint="rail" kv="30" forcerange="-20 30"/>
          <general name="winch" tendon="rope" dyntype="filterexact" dynprm=".02"/></actuator>""",
        {
            "u": tells("belt"),
            "f": Channel(clock="c", role="control", quantity="force", unit="N", joint="mast"),
            "w": tells("winch"),
            "q": reads(site="cart"),
            "h": Channel(clock="c", role="observation", quantity="position", unit="m", joint="mast"),
        },
        [],
        lambda t: [0.8 * np.sin(6 * t), 4 * np.sin(11 * t), 10 + 5 * np.sin(8 * t)],
    )


def ball() -> RigSimulator:
    """A ball that flies."""
    return bench(
        """<worldbody><body name="ball"><freejoint/><geom size=".03" mass=".05"/></body></worldbody>""",
        {"x": reads(body="ball"), "z": reads(body="ball").model_copy(update={"component": "z"})},
        [0, 0, 1, 1, 0, 0, 0, 4, 1, 3, 0, 20, 0],
    )


def chain() -> RigSimulator:
    """Seven hinges with servos, each across the one before, with inertias about axes of their own."""
    links, ends = "", ""
    for i in range(7):
        axis = ("0 0 1", "0 1 0")[i % 2]
        place = "" if i == 0 else 'pos="0 0 .2"'
        links += (
            f'<body name="link{i}" {place}><joint name="a{i}" axis="{axis}" armature=".1"/>'
            f'<inertial pos=".01 .02 .1" quat=".9 .1 .3 .2" mass="{4 - 0.5 * i}" diaginertia=".03 .02 .015"/>'
            '<geom type="capsule" fromto="0 0 0 0 0 .2" size=".05"/>'
        )
        ends += "</body>"
    servos = "".join(f'<position name="s{i}" joint="a{i}" kp="200" kv="10"/>' for i in range(7))
    rates = 4 + np.arange(7)
    return bench(
        f"""<option integrator="implicitfast"/><worldbody>{links}{ends}</worldbody>
        <actuator>{servos}</actuator>""",
        {f"u{i}": tells(f"s{i}") for i in range(7)} | {f"q{i}": reads(joint=f"a{i}") for i in range(7)},
        [0.3] * 7,
        lambda t: [0.3 + 0.4 * np.sin(rate * t) for rate in rates],
        seconds=0.1,
    )


BENCHES = {"arm": arm, "pendulum": pendulum, "slide": slide, "ball": ball, "chain": chain}


def few(bench: RigSimulator) -> list[JointEffect]:
    """All instances that the model can bear as it is; of many forms at one part the first and the last."""
    kept = {}
    for effect in bench.effects:
        key = effect.key
        if overrides(effect, "restructure"):
            continue
        if effect.many_forms:
            ends = [e for e in bench.effects if (e.name, e.part) == (effect.name, effect.part)]
            if effect not in (ends[0], ends[-1]):
                continue
        kept[key] = effect
    return list(kept.values())


def start(effect: JointEffect) -> np.ndarray:
    return np.array([p.start for p in effect.parameters])


def one_sd(effect: JointEffect) -> np.ndarray:
    """A prior standard deviation from the start, within bounds."""
    return np.array(
        [p.start + (p.scale if p.start + p.scale <= p.high else -p.scale) for p in effect.parameters]
    )


def has_note(effect: JointEffect) -> bool:
    """Whether a model cannot hold all of an effect; a variant may change the model alone."""
    says = any(overrides(effect, place) for place in ("control", "force", "observe"))
    return (says and "geometry" not in effect.variant) or "at the link" in effect.variant
