"""Does a 90 % interval hold the true value? Every effect's own law is the truth, and it alone is fitted."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slapshot.arrays import Array
from slapshot.calibration.rig_simulator import (
    INTERVAL,
    WHITE_NOISE,
    Drive,
    RigSimulator,
    recorded,
    rig_simulator_named,
)
from slapshot.diagnosis.diagnose import named_parameter
from slapshot.diagnosis.inference.scores import gains
from slapshot.diagnosis.problem import Examination, Problem, examine
from slapshot.diagnosis.search import Step, first_values, nominal_step, refit, structured
from slapshot.diagnosis.segments import cut
from slapshot.effects.joints.catalogue import joint_effects
from slapshot.effects.joints.effect import JointEffect, Situation
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse

BENCHES = ("pendulum", "arm", "ball")  # the simplest first
# A pendulum swings in a plane: a tilt sideways changes next to nothing, and nothing tells left from right.
_NEEDS = {"gravity_tilt": "arm"}
_PULSE = (2, 0.4, 0.5)  # episode, and shares of its length between which something pushes
_OF_MANY = 0.25  # of forms of one effect, which one is the truth


@dataclass(frozen=True)
class Law:
    """An effect in one of its variants, on the simplest rig that it shows on."""

    effect: str
    variant: str
    bench: str


def laws(effect: str) -> list[Law]:
    """All variants of an effect of the catalogue."""
    found: dict[str, Law] = {}
    for name in [_NEEDS[effect]] if effect in _NEEDS else BENCHES:
        bench = rig_simulator_named(name)
        drive = bench.draw(6, 1.0, np.random.default_rng(0))
        for one in _instances(_nominal(bench, drive).situation, effect, drive):
            variant = "" if effect == ExternalPulse.name else one.variant
            found.setdefault(variant, Law(effect, variant, name))
    return list(found.values())


def intervals(law: Law, seed: int, episodes: int, seconds: float) -> Iterator[dict[str, Any]]:
    """Make a recording, fit it, and say for each parameter what was true and what its interval is.

    Args:
        law: the truth.
        seed: of motion, values and noise, with the law's name.
        episodes: of the recording.
        seconds: length of an episode.
    """
    # Each law draws for itself: else all would be moved alike and have the same noise.
    rng = np.random.default_rng([seed, *f"{law.effect} {law.variant}".encode()])
    bench = rig_simulator_named(law.bench)
    drive = bench.draw(episodes, seconds, rng)
    nominal = _nominal(bench, drive)
    effect = _chosen(law, nominal.situation, drive)
    truth = drawn(effect, rng)
    noise = WHITE_NOISE * rng.standard_normal((*drive.told.shape[:2], len(bench.rig.observations)))
    recording = recorded(bench, drive, effect, truth, noise)
    # Scales of the nominal motion, so that the prior is the one that the truth was drawn from.
    problem = replace(
        Problem.of(bench.rig, bench.channels, cut(recording, bench.rig)), situation=nominal.situation
    )
    examined = fitted(problem, effect, rng)
    for k, parameter in enumerate(effect.parameters):
        row = {"effect": law.effect, "variant": law.variant, "rig": law.bench, "part": effect.part,
               "parameter": parameter.name, "seed": seed, "truth": truth[k]}  # fmt: skip
        if examined is None:
            yield row | {"value": np.nan, "low": np.nan, "high": np.nan, "state": "", "converged": False}
            continue
        fit = examined.fit
        found = named_parameter(parameter, float(fit.theta[k]), float(fit.sd[k]))
        yield row | {
            "value": found.value,
            "low": found.low,
            "high": found.high,
            "state": found.state,
            "converged": fit.converged,
        }


def fitted(problem: Problem, effect: JointEffect, rng: np.random.Generator) -> Examination | None:
    """The fit that a search makes of an effect which it names; None where there is no fit."""
    try:
        nominal = nominal_step(problem, (), rng)
        if effect.hidden_state:
            return structured(nominal, effect)
        fit = refit(nominal, effect, _start(nominal, effect))
        return examine(problem, fit.hypothesis, fit.theta, fit.path, nominal.examination.noise)
    except np.linalg.LinAlgError:
        return None


def drawn(effect: JointEffect, rng: np.random.Generator) -> Array:
    """Values from the priors, within what is possible."""
    values = []
    for parameter in effect.parameters:
        value = np.nan
        while not parameter.low <= value <= parameter.high:
            value = parameter.start + parameter.scale * rng.standard_normal()
        values.append(value)
    return np.array(values)


def _nominal(bench: RigSimulator, drive: Drive) -> Problem:
    """Of the motion of the nominal model."""
    recording = recorded(bench, drive, None, np.zeros(0))
    return Problem.of(bench.rig, bench.channels, cut(recording, bench.rig))


def _instances(scales: Situation, effect: str, drive: Drive) -> list[JointEffect]:
    if effect != ExternalPulse.name:
        return list(joint_effects()[effect].instances(scales))
    # Its times are found in data; here they are known.
    episode, *within = _PULSE
    begin, end = (share * drive.told.shape[1] * INTERVAL for share in within)
    order = float(np.linspace(-0.5, 0.5, len(drive.told))[episode])
    return [ExternalPulse(joint, [Pulse(episode, order, begin, end)]) for joint in scales.joints]


def _chosen(law: Law, scales: Situation, drive: Drive) -> JointEffect:
    """At the first part; of many forms, one that is neither the slowest nor the fastest."""
    own = _instances(scales, law.effect, drive)
    own = [e for e in own if law.effect == ExternalPulse.name or e.variant == law.variant]
    own = [e for e in own if e.part == own[0].part]
    return own[int(_OF_MANY * len(own))]


def _start(nominal: Step, effect: JointEffect) -> Array:
    """Where a fit begins: where the columns of the nominal model's scores point."""
    examined = nominal.examination
    keys = [candidate.key for candidate in examined.effects]
    if effect.key not in keys:
        return np.array([parameter.start for parameter in effect.parameters])
    index = keys.index(effect.key)
    return first_values(examined, index, gains(examined.scores, examined.columns)[index].values)
