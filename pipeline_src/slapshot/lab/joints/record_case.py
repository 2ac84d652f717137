"""Record a case: a rig with hidden effects, and a session on it."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.errors import InputError
from slapshot.json_types import JsonObject
from slapshot.lab.joints.case_spec import CaseSpec, Colour, MeasurementCondition
from slapshot.lab.joints.clutter import LawError
from slapshot.lab.joints.effect_size_calibration import EffectSizeCalibration, change
from slapshot.lab.joints.execution import SimulatedMotion
from slapshot.lab.joints.hidden_effect import Concealed
from slapshot.lab.joints.noise import CORRELATION, draw_sensor_noise, quantise, read_clean
from slapshot.lab.joints.registry import hidden_effect_named
from slapshot.lab.joints.rig import Rig, draw_excitation
from slapshot.lab.joints.rigs import rig_named
from slapshot.lab.rng_streams import stream_for
from slapshot.recordings.signals import SignalRecording

SIZES = (0.3, 30.0)  # from undetectable to obvious (5 and more)
ORACLE_EPISODES = 4  # last episodes whose noiseless record is stored in the truth
INCOMPATIBLE = {"joint_elasticity", "backlash"}
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
) -> tuple[SignalRecording, JsonObject]:
    """Record a session on a rig with hidden effects.

    Args:
        rig: pendulum, arm, kuka or fetchslide_arm.
        kinds: hidden effects, in `registry.HIDDEN_EFFECTS`; empty for a null.
        seed: of everything that is drawn.
        noise: colour of the encoders' noise of 1 mrad (or mm); ou20 and ou100 have a correlation time of 20
            and 100 ms.
        cluttered: whether the rig's laws are off by 10 %, times jitter, noise has heavy tails and drifts.
        quantised: rad, step of the encoders; None for fine ones.
        episodes: of the session.
        seconds: of an episode.
        size: of each effect over the noise, see `effect_size_calibration`; log-uniform from 0.3 to 30 if
            None.

    Returns:
        The recording, with no digest of a truth yet, and the truth, which can be written as JSON.

    Raises:
        InputError: the rig or an effect is unknown, or an effect does not fit the rig.
    """
    if noise not in CORRELATION:
        raise InputError(f"lab: no noise {noise!r}; use one of: {', '.join(CORRELATION)}")
    return make(
        CaseSpec(
            rig=rig,
            seed=seed,
            conceals=tuple((effect, size) for effect in kinds),
            condition=MeasurementCondition(noise, cluttered, quantised),
            episodes=episodes,
            seconds=seconds,
        )
    )


def make(spec: CaseSpec) -> tuple[SignalRecording, JsonObject]:
    """See `make_case`."""
    rig = rig_named(spec.rig)
    check_hidden_effects([effect for effect, _ in spec.conceals], rig)
    excitation_rng, concealed_rng, clutter_rng, noise_rng = np.random.default_rng(spec.seed).spawn(4)
    excitation = draw_excitation(rig, spec.episodes, spec.seconds, excitation_rng)
    size_calibration = EffectSizeCalibration(rig, excitation)
    law_error: JsonObject | None = None
    if spec.condition.cluttered:
        error, plain = LawError(size_calibration.nominal, clutter_rng), size_calibration.nominal.positions
        size_calibration = EffectSizeCalibration(rig, excitation, [error.law])
        law_error = error.truth() | {"size": change(size_calibration.nominal.positions, plain)}
    concealed = [
        _find(size_calibration, effect, size, stream_for(concealed_rng, effect))
        for effect, size in spec.conceals
    ]
    motion = size_calibration.motion(concealed)
    if motion is None:
        raise InputError(f"lab: rig {rig.name} is unstable with these effects; use another seed")
    clean = read_clean(rig, motion, concealed)
    sensor_noise = draw_sensor_noise(spec.condition, clean.shape, rig.clock.sample, noise_rng)
    readings = read_clean(rig, motion, concealed, sensor_noise.sample_delay) + sensor_noise.added
    truth: JsonObject = {
        "stand_in": True,
        "rig": rig.name,
        "seed": spec.seed,
        "condition": {
            "noise": spec.condition.noise,
            "cluttered": spec.condition.cluttered,
            "quantised_rad": spec.condition.quantised,
            "episodes": spec.episodes,
            "seconds": spec.seconds,
        },
        "kinds": [c.effect.name for c in concealed],
        "size": size_calibration.size(concealed, motion),
        "concealed": [c.truth() for c in concealed],
        "chance": sensor_noise.truth,
        "law_error": law_error,
        "noiseless": _noiseless(rig, clean),
    }
    return _recording(rig, motion, quantise(readings, spec.condition.quantised)), truth


def check_hidden_effects(kinds: Sequence[str], rig: Rig) -> None:
    """Refuse hidden effects that do not fit a rig.

    Raises:
        InputError: an effect is unknown, duplicate or does not fit, or two are incompatible.
    """
    if set(kinds) >= INCOMPATIBLE:
        raise InputError(f"lab: {' and '.join(sorted(INCOMPATIBLE))} split the same joint; use one of them")
    for effect in kinds:
        if not hidden_effect_named(effect).fits(rig):
            raise InputError(f"lab: {effect} is not observable on rig {rig.name}; use another effect or rig")
        if kinds.count(effect) > 1:
            raise InputError(f"lab: {effect} is given twice; name it once, with a larger size")


def _find(
    size_calibration: EffectSizeCalibration, effect: str, size: float | None, rng: np.random.Generator
) -> Concealed:
    shape_rng, size_rng = rng.spawn(2)
    if size is None:
        size = float(np.exp(size_rng.uniform(*np.log(SIZES))))
    return size_calibration.find(hidden_effect_named(effect), size, shape_rng)


def _noiseless(rig: Rig, clean: Array) -> JsonObject:
    """Noiseless readings of the last episodes, rounded to 1e-8 rad or m."""
    first = max(0, len(clean) - ORACLE_EPISODES)
    values = np.round(clean[first:], 8)
    return {
        "episodes": list(range(first, len(clean))),
        "channels": {name: values[..., i].tolist() for i, name in enumerate(rig.observations())},
    }


def _recording(rig: Rig, motion: SimulatedMotion, readings: Array) -> SignalRecording:
    controls, observations = rig.controls(), rig.observations()
    signals: dict[str, dict[str, NDArray[np.generic]]] = {}
    for channels, values, period in (
        (controls, motion.commands, rig.clock.period),
        (observations, readings, rig.clock.sample),
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
    number = np.arange(len(readings))
    return SignalRecording(
        rig=f"stand-in {rig.name}",
        stand_in=True,
        note=NOTE,
        sealed_truth_sha256=None,
        channels=controls | observations,
        episodes=pd.DataFrame({"episode": number, "order": number}),
        signals={clock: pd.DataFrame(table) for clock, table in signals.items()},
    )
