"""A case: a rig, what it conceals, and a session that is recorded of it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from slapshot.arrays import Array
from slapshot.errors import InputError
from slapshot.lab.joints.case_specs import Colour, Condition, Order
from slapshot.lab.joints.clutter import LawError
from slapshot.lab.joints.effect_size_calibration import Rehearsal, change
from slapshot.lab.joints.execution import Motion
from slapshot.lab.joints.hidden_effect import Concealed
from slapshot.lab.joints.noise import CORRELATION, draw_sensor_noise, quantise, read_clean
from slapshot.lab.joints.registry import hidden_effect_named
from slapshot.lab.joints.rig import Rig, draw_excitation
from slapshot.lab.joints.rigs import rig_named
from slapshot.lab.rng_streams import stream_for
from slapshot.recordings.signals import SignalRecording

SIZES = (0.3, 30.0)  # from undetectable to plain, which is 5 and more
ORACLE = 4  # last episodes whose noiseless record is in the truth
TOGETHER_NEVER = {"joint_elasticity", "backlash"}
NOTE = (
    "STAND-IN: this recording was simulated by slapshot's lab; no real robot was involved. The rig's "
    "physics is concealed in a sealed file whose digest is given. Commands are what actuators were told, "
    "positions what encoders told. Every episode begins at rest at its first command, or nearly so."
)


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
        rig: pendulum, arm, kuka or fetchslide_arm.
        kinds: what it conceals, in `registry.HIDDEN_EFFECTS`; nothing for a null.
        seed: of everything that is drawn.
        noise: colour of the encoders' noise of 1 mrad (or mm); ou20 and ou100 have a correlation time of 20
            and 100 ms.
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
    law_error = None
    if order.condition.cluttered:
        error, plain = LawError(rehearsal.setting, clutter_rng), rehearsal.setting.positions
        rehearsal = Rehearsal(rig, excitation, [error.law])
        law_error = error.truth() | {"size": change(rehearsal.setting.positions, plain)}
    concealed = [
        _find(rehearsal, kind, size, stream_for(concealed_rng, kind)) for kind, size in order.conceals
    ]
    motion = rehearsal.motion(concealed)
    if motion is None:
        raise InputError(f"lab: rig {rig.name} falls apart when it conceals all that; take another seed")
    clean = read_clean(rig, motion, concealed)
    chance = draw_sensor_noise(order.condition, clean.shape, rig.clock.sample, chance_rng)
    told = read_clean(rig, motion, concealed, chance.late) + chance.added
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
        "law_error": law_error,
        "noiseless": _noiseless(rig, clean),
    }
    return _recording(rig, motion, quantise(told, order.condition.quantised)), truth


def check_kinds(kinds: Sequence[str], rig: Rig) -> None:
    """Refuse what a rig cannot conceal.

    Raises:
        InputError: a kind is unknown, stands twice or does not fit, or two contradict each other.
    """
    if set(kinds) >= TOGETHER_NEVER:
        raise InputError(f"lab: {' and '.join(sorted(TOGETHER_NEVER))} part the same joint; take one of them")
    for kind in kinds:
        if not hidden_effect_named(kind).fits(rig):
            raise InputError(f"lab: {kind} does not show on rig {rig.name}; take another kind or rig")
        if kinds.count(kind) > 1:
            raise InputError(f"lab: {kind} stands twice; name it once, with a larger size")


def _find(rehearsal: Rehearsal, kind: str, size: float | None, rng: np.random.Generator) -> Concealed:
    shape_rng, size_rng = rng.spawn(2)
    if size is None:
        size = float(np.exp(size_rng.uniform(*np.log(SIZES))))
    return rehearsal.find(hidden_effect_named(kind), size, shape_rng)


def _noiseless(rig: Rig, clean: Array) -> dict[str, Any]:
    """What encoders told in the last episodes, but for chance: rounded to 1e-8 rad or m."""
    first = max(0, len(clean) - ORACLE)
    values = np.round(clean[first:], 8)
    return {
        "episodes": list(range(first, len(clean))),
        "channels": {name: values[..., i].tolist() for i, name in enumerate(rig.observations())},
    }


def _recording(rig: Rig, motion: Motion, told: Array) -> SignalRecording:
    controls, observations = rig.controls(), rig.observations()
    signals: dict[str, dict[str, Any]] = {}
    for channels, values, period in (
        (controls, motion.told, rig.clock.period),
        (observations, told, rig.clock.sample),
    ):
        episodes, samples = values.shape[:2]
        for i, (name, channel) in enumerate(channels.items()):
            table = signals.setdefault(
                channel.clock,
                {
                    "episode": np.repeat(np.arange(episodes), samples),
                    "t": np.tile(np.arange(samples) * period, episodes),
                },
            )
            table[name] = values[..., i].ravel()
    number = np.arange(len(told))
    return SignalRecording(
        rig=f"stand-in {rig.name}",
        stand_in=True,
        note=NOTE,
        sealed_truth_sha256=None,
        channels=controls | observations,
        episodes=pd.DataFrame({"episode": number, "order": number}),
        signals={clock: pd.DataFrame(table) for clock, table in signals.items()},
    )
