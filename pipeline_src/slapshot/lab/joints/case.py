"""A case: a rig, what it conceals, and a session that is recorded of it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from slapshot.errors import InputError
from slapshot.lab.joints.bench import Motion, draw_excitation
from slapshot.lab.joints.clutter import LawError
from slapshot.lab.joints.kind import Array, Concealed
from slapshot.lab.joints.noise import (
    CORRELATION,
    Colour,
    Condition,
    draw_chance,
    quantise,
    read_clean,
)
from slapshot.lab.joints.registry import kind_named
from slapshot.lab.joints.rehearsal import Rehearsal
from slapshot.lab.joints.rig import CONTROL_PERIOD, Rig, rig_named
from slapshot.lab.streams import stream_for
from slapshot.recordings.channels import Channel
from slapshot.recordings.signals import SignalRecording

SIZES = (0.3, 30.0)  # from undetectable to plain, which is 5 and more
ORACLE = 4  # last episodes whose noiseless record is in the truth
TOGETHER_NEVER = {"joint_elasticity", "backlash"}
CLOCK = "encoders"
NOTE = (
    "STAND-IN: this recording was simulated by slapshot's lab; no real robot was involved. The rig's "
    "physics is concealed in a sealed file whose digest is given. Commands are what actuators were told, "
    "positions what encoders told. Every episode begins at rest at its first command, or nearly so."
)


@dataclass(frozen=True)
class Order:
    """What a case is to be.

    Attributes:
        rig: by name.
        seed: of everything that is drawn.
        conceals: kind and size over the noise of each piece of physics; None where the size is drawn.
        condition: how it is recorded.
        episodes: of the session.
        seconds: of an episode.
    """

    rig: str
    seed: int
    conceals: tuple[tuple[str, float | None], ...] = ()
    condition: Condition = field(default_factory=Condition)
    episodes: int = 20
    seconds: float = 3.0


def make_case(
    rig: str,
    kinds: Sequence[str],
    seed: int,
    *,
    noise: Colour = "white",
    cluttered: bool = False,
    quantised: float | None = None,
    episodes: int = 20,
    seconds: float = 3.0,
    size: float | None = None,
) -> tuple[SignalRecording, dict[str, Any]]:
    """Record a session on a rig that conceals kinds of physics.

    Args:
        rig: pendulum, arm or kuka.
        kinds: what it conceals, in `registry.KINDS`; nothing for a null.
        seed: of everything that is drawn.
        noise: colour of the encoders' noise of 1 mrad; ou20 and ou100 have a correlation time of 20 and
            100 ms.
        cluttered: whether the rig's laws are off by 10 %, times jitter, noise has heavy tails and drifts.
        quantised: rad, step of the encoders; None for fine ones.
        episodes: of the session.
        seconds: of an episode.
        size: of each kind over the noise, see `rehearsal`; drawn log-uniformly from 0.3 to 30 if None.

    Returns:
        The recording, with no digest of a truth yet, and the truth, which can be written as JSON.

    Raises:
        InputError: there is no such rig or kind, or a kind does not fit the rig.
    """
    if noise not in CORRELATION:
        raise InputError(f"lab: no noise {noise!r}; use one of: {', '.join(CORRELATION)}")
    return make(
        Order(
            rig=rig,
            seed=seed,
            conceals=tuple((kind, size) for kind in kinds),
            condition=Condition(noise, cluttered, quantised),
            episodes=episodes,
            seconds=seconds,
        )
    )


def make(order: Order) -> tuple[SignalRecording, dict[str, Any]]:
    """See `make_case`."""
    rig = rig_named(order.rig)
    check_kinds([kind for kind, _ in order.conceals], rig)
    excitation_rng, concealed_rng, clutter_rng, chance_rng = np.random.default_rng(order.seed).spawn(4)
    excitation = draw_excitation(rig, order.episodes, order.seconds, excitation_rng)
    rehearsal = Rehearsal(rig, excitation)
    error = None
    if order.condition.cluttered:
        error = LawError(rehearsal.setting, clutter_rng)
        rehearsal = Rehearsal(rig, excitation, [error.law])
    concealed = [
        _find(rehearsal, kind, size, stream_for(concealed_rng, kind)) for kind, size in order.conceals
    ]
    motion = rehearsal.motion(concealed)
    if motion is None:
        raise InputError(f"lab: rig {rig.name} falls apart when it conceals all that; take another seed")
    chance = draw_chance(order.condition, motion.told.shape, chance_rng)
    angles = read_clean(motion, concealed, chance.late) + chance.added
    clean = read_clean(motion, concealed)
    truth = {
        "stand_in": True,
        "rig": rig.name,
        "seed": order.seed,
        "condition": {
            "noise": order.condition.noise,
            "cluttered": order.condition.cluttered,
            "quantised_rad": order.condition.quantised,
            "episodes": order.episodes,
            "seconds": order.seconds,
        },
        "kinds": [c.kind.name for c in concealed],
        "size": rehearsal.size(concealed, motion),
        "concealed": [c.truth() for c in concealed],
        "chance": chance.truth,
        "law_error": None if error is None else error.truth(),
        "noiseless": _noiseless(rig, clean),
    }
    return _recording(rig, motion, quantise(angles, order.condition.quantised)), truth


def check_kinds(kinds: Sequence[str], rig: Rig) -> None:
    """Refuse what a rig cannot conceal.

    Raises:
        InputError: a kind is unknown, stands twice or does not fit, or two contradict each other.
    """
    if set(kinds) >= TOGETHER_NEVER:
        raise InputError(f"lab: {' and '.join(sorted(TOGETHER_NEVER))} part the same joint; take one of them")
    for kind in kinds:
        if not kind_named(kind).fits(rig):
            raise InputError(f"lab: {kind} does not show on rig {rig.name}; take another kind or rig")
        if kinds.count(kind) > 1:
            raise InputError(f"lab: {kind} stands twice; name it once, with a larger size")


def _find(rehearsal: Rehearsal, kind: str, size: float | None, rng: np.random.Generator) -> Concealed:
    shape_rng, size_rng = rng.spawn(2)
    if size is None:
        size = float(np.exp(size_rng.uniform(*np.log(SIZES))))
    return rehearsal.find(kind_named(kind), size, shape_rng)


def _noiseless(rig: Rig, clean: Array) -> dict[str, Any]:
    """What encoders told in the last episodes, but for chance: rounded to 1e-8 rad."""
    first = max(0, len(clean) - ORACLE)
    return {
        "episodes": list(range(first, len(clean))),
        "rad": {
            _position(joint): np.round(clean[first:, :, i], 8).tolist() for i, joint in enumerate(rig.joints)
        },
    }


def _position(joint: str) -> str:
    return f"{joint}_position"


def _recording(rig: Rig, motion: Motion, angles: Array) -> SignalRecording:
    episodes, samples, _ = angles.shape
    channels: dict[str, Channel] = {}
    columns: dict[str, Any] = {
        "episode": np.repeat(np.arange(episodes), samples),
        "t": np.tile(np.arange(samples) * CONTROL_PERIOD, episodes),
    }
    for i, joint in enumerate(rig.joints):
        name = f"{joint}_command"
        channels[name] = Channel(
            clock=CLOCK, role="control", quantity="command", actuator=joint, unit=rig.command_unit
        )
        columns[name] = motion.told[..., i].ravel()
    for i, joint in enumerate(rig.joints):
        channels[_position(joint)] = Channel(
            clock=CLOCK, role="observation", quantity="position", joint=joint, unit="rad"
        )
        columns[_position(joint)] = angles[..., i].ravel()
    number = np.arange(episodes)
    return SignalRecording(
        rig=f"stand-in {rig.name}",
        stand_in=True,
        note=NOTE,
        sealed_truth_sha256=None,
        channels=channels,
        episodes=pd.DataFrame({"episode": number, "order": number}),
        signals={CLOCK: pd.DataFrame(columns)},
    )
