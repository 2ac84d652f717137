"""Coverage of 90 % intervals: each effect's own law is simulated, and that effect alone is fitted."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from slapshot.arrays import Array
from slapshot.calibration.calibration_rigs import (
    INTERVAL,
    WHITE_NOISE,
    CalibrationRig,
    Motion,
    calibration_rig,
    simulate_recording,
)
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.diagnosis.selection.problem import Problem, ScoredFit, fit_and_score
from slapshot.diagnosis.selection.steps import Step, nominal_motion, nominal_step, one_step_values, refit
from slapshot.diagnosis.selection.structural_search import structural_fit
from slapshot.diagnosis.verdict_of_search import estimated_parameter
from slapshot.effects.joints.catalogue import joint_effects
from slapshot.effects.joints.effect import JointEffect, RigMotion
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse
from slapshot.json_types import Row

RIGS = ("pendulum", "arm", "ball")  # the simplest first
# A pendulum swings in a plane: a sideways tilt changes next to nothing, and its sign is not identifiable.
_REQUIRED_RIG = {"gravity_tilt": "arm", "base_compliance": "arm"}
_PULSE = (2, 0.4, 0.5)  # episode, and begin and end of the push as shares of its length
_CHOSEN_FRACTION = 0.25  # which of many forms of an effect is simulated, as a share


@dataclass(frozen=True)
class CalibratedEffect:
    """An effect in one of its variants, on the simplest rig on which it is observable."""

    effect: str
    variant: str
    rig: str


def calibrated_effects(effect: str) -> list[CalibratedEffect]:
    """All variants of an effect of the catalogue."""
    found: dict[str, CalibratedEffect] = {}
    for name in [_REQUIRED_RIG[effect]] if effect in _REQUIRED_RIG else RIGS:
        simulated = calibration_rig(name)
        motion = simulated.draw(6, 1.0, np.random.default_rng(0))
        for one in _instances(_nominal(simulated, motion).rig_motion, effect, motion):
            variant = "" if effect == ExternalPulse.name else one.variant
            found.setdefault(variant, CalibratedEffect(effect, variant, name))
    return list(found.values())


def intervals(tested: CalibratedEffect, seed: int, episodes: int, seconds: float) -> Iterator[Row]:
    """Simulate a recording, fit it, and return truth and interval of each parameter.

    Args:
        tested: the simulated effect.
        seed: of motion, values and noise, combined with the effect's name.
        episodes: of the recording.
        seconds: length of an episode.
    """
    # Each effect has its own stream, otherwise all would share motion and noise.
    rng = np.random.default_rng([seed, *f"{tested.effect} {tested.variant}".encode()])
    simulated = calibration_rig(tested.rig)
    motion = simulated.draw(episodes, seconds, rng)
    nominal = _nominal(simulated, motion)
    effect = _select_instance(tested, nominal.rig_motion, motion)
    truth = draw_from_prior(effect, rng)
    noise = WHITE_NOISE * rng.standard_normal((*motion.commands.shape[:2], len(simulated.rig.observations)))
    recording = simulate_recording(simulated, motion, effect, truth, noise)
    # Scales of the nominal motion, so that the prior is the one that the truth was drawn from.
    problem = replace(
        Problem.of(simulated.rig, simulated.channels, segment_recording(recording, simulated.rig)),
        rig_motion=nominal.rig_motion,
    )
    scored = fitted(problem, effect, rng)
    for k, parameter in enumerate(effect.parameters):
        row = {"effect": tested.effect, "variant": tested.variant, "rig": tested.rig, "part": effect.part,
               "parameter": parameter.name, "seed": seed, "truth": truth[k]}  # fmt: skip
        if scored is None:
            yield row | {"value": np.nan, "low": np.nan, "high": np.nan, "state": "", "converged": False}
            continue
        fit = scored.fit
        found = estimated_parameter(parameter, float(fit.theta[k]), float(fit.sd[k]))
        yield row | {
            "value": found.value,
            "low": found.low,
            "high": found.high,
            "state": found.state,
            "converged": fit.settled,
        }


def fitted(problem: Problem, effect: JointEffect, rng: np.random.Generator) -> ScoredFit | None:
    """The fit of an effect as in a search; None if it fails."""
    try:
        nominal = nominal_step(nominal_motion(problem, ()), rng)
        if effect.hidden_state:
            return structural_fit(nominal, effect)
        fit = refit(nominal, effect, _initial_values(nominal, effect))
        scored, _ = fit_and_score(problem, fit.hypothesis, fit.theta, fit.trajectory, nominal.scored.noise)
        return scored
    except np.linalg.LinAlgError:
        return None


def draw_from_prior(effect: JointEffect, rng: np.random.Generator) -> Array:
    """Values from the priors, truncated to their bounds."""
    values = []
    for parameter in effect.parameters:
        value = np.nan
        while not parameter.low <= value <= parameter.high:
            value = parameter.start + parameter.scale * rng.standard_normal()
        values.append(value)
    return np.array(values)


def _nominal(simulated: CalibrationRig, motion: Motion) -> Problem:
    """The problem of a noise-free recording of the nominal model."""
    recording = simulate_recording(simulated, motion, None, np.zeros(0))
    return Problem.of(simulated.rig, simulated.channels, segment_recording(recording, simulated.rig))


def _instances(scales: RigMotion, effect: str, motion: Motion) -> list[JointEffect]:
    if effect != ExternalPulse.name:
        return list(joint_effects()[effect].instances(scales))
    # Its times are detected in data; here they are known.
    episode, *within = _PULSE
    begin, end = (wilson_share * motion.commands.shape[1] * INTERVAL for wilson_share in within)
    order = float(np.linspace(-0.5, 0.5, len(motion.commands))[episode])
    return [ExternalPulse(joint, [Pulse(episode, order, begin, end)]) for joint in scales.joints]


def _select_instance(tested: CalibratedEffect, scales: RigMotion, motion: Motion) -> JointEffect:
    """The instance at the first part; of many forms, an intermediate one."""
    own = _instances(scales, tested.effect, motion)
    own = [e for e in own if tested.effect == ExternalPulse.name or e.variant == tested.variant]
    own = [e for e in own if e.part == own[0].part]
    return own[int(_CHOSEN_FRACTION * len(own))]


def _initial_values(nominal: Step, effect: JointEffect) -> Array:
    """Initial values of a fit, from the scores of the nominal model."""
    scored = nominal.scored
    keys = [candidate.key for candidate in scored.effects]
    if effect.key not in keys:
        return np.array([parameter.start for parameter in effect.parameters])
    index = keys.index(effect.key)
    return one_step_values(scored, index, scored.gains[index].values)
