"""Laws that are named have small errors of shape, which are nothing unknown: a gain that fades with load."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis import held_out
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.fit.noise import TYPICAL_LAW_ERROR
from slapshot.diagnosis.held_out_validation import predict_windows
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.diagnosis.selection import steps
from slapshot.diagnosis.selection.problem import Problem
from slapshot.diagnosis.selection.steps import (
    P_VALUE,
    Step,
    beside_law_errors,
    nominal_motion,
    nominal_step,
    refit,
    step_to,
)
from slapshot.diagnosis.verdict_of_search import MAX_REDUCED_CHI2
from slapshot.effects.joints.actuator_gain import ActuatorGain
from slapshot.recordings.signals import SignalRecording

from .mechanisms import PENDULUM, control_channel, joint, recording, simulate

GAIN, FADES, LARGEST = 0.25, 0.15, 3.0  # excess; share of it that is gone at the largest torque, in N m
ROD = PENDULUM.replace('timestep="0.01"', 'timestep="0.001"')
SPRING = ROD.replace('damping="0.05"', 'damping="0.05" stiffness="0.1"')


@dataclass(frozen=True)
class ErrorOfLaws:
    """What of a noise decides."""

    added_error: float


def fading(u: np.ndarray) -> np.ndarray:
    """What the motor makes of a torque."""
    return u * (1 + GAIN * (1 - FADES * np.abs(u) / LARGEST))


def driven(true: str, seed: int) -> tuple[SignalRecording, Rig]:
    """Eight episodes of 2 s of a rod whose motor does not make the torque that it is told."""
    rng, t = np.random.default_rng(seed), np.arange(200) * 0.01
    angles, torques = [], []
    for _ in range(8):
        parts = [
            rng.uniform(0.5, 1.5) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.5, 1.1, 1.9)
        ]
        u = np.sum(parts, axis=0)
        qpos, *_ = simulate(true, t, fading(u)[:, None], [rng.uniform(-1, 1)], [0.0], finer=2)
        angles.append(qpos[:, 0] + 2e-4 * rng.standard_normal(len(t)))
        torques.append(u)
    data = {"angle": (joint("swing"), angles), "torque": (control_channel(actuator="drive"), torques)}
    made = recording([t] * 8, data)
    return made, bind(MjSpec.from_string(ROD), made.channels)


def with_gain(true: str, seed: int) -> Step:
    """The step of a search that adds the gain."""
    made, rig = driven(true, seed)
    problem, rng = Problem.of(rig, made.channels, segment_recording(made, rig)), np.random.default_rng(seed)
    step = nominal_step(nominal_motion(problem, ()), rng)
    (gain,) = ActuatorGain.instances(problem.rig_motion)
    fit = refit(step, gain, np.array([0.2]))
    return step_to(step, fit, gain, fit.log_evidence - step.scored.fit.log_evidence, (), rng)


@pytest.mark.parametrize(("true", "more"), [(ROD, False), (SPRING, True)], ids=["alone", "spring"])
def test_what_a_few_per_cent_of_a_named_law_explain_is_nothing_unknown(true, more):
    step = with_gain(true, 1)
    assert step.test.p_value < P_VALUE
    assert step.scored.noise.added_error < TYPICAL_LAW_ERROR
    beside = beside_law_errors(step, np.random.default_rng(2))
    assert (beside.test.p_value < P_VALUE) == more
    assert beside.scored.noise.added_error == TYPICAL_LAW_ERROR


@pytest.mark.parametrize(("empirical", "error", "fits"), [(False, 0.01, 0), (True, 0.05, 0), (True, 0.01, 1)])
def test_a_step_stays_as_it_is_where_larger_errors_of_laws_tell_nothing(monkeypatch, empirical, error, fits):
    """No law that was added is empirical, errors of these are as large already, or a refit diverges."""
    asked = []

    def diverges(problem, fit, noise):
        asked.append(noise.added_error)
        raise np.linalg.LinAlgError

    monkeypatch.setattr(steps, "scored_under", diverges)
    scored = SimpleNamespace(noise=ErrorOfLaws(error), fit=None)
    added, free = SimpleNamespace(empirical=empirical), SimpleNamespace(empirical=True)
    hypothesis = SimpleNamespace(added=(added,), effects=(free, added))
    step = SimpleNamespace(problem=None, scored=scored, hypothesis=hypothesis)
    assert beside_law_errors(step, np.random.default_rng(0)) is step
    assert steps.with_typical_errors(scored.noise, hypothesis) == ErrorOfLaws(
        TYPICAL_LAW_ERROR if fits else error
    )
    assert asked == [TYPICAL_LAW_ERROR] * fits


@pytest.mark.parametrize("true", [ROD, SPRING], ids=["alone", "spring"])
def test_held_out_windows_have_the_same_allowance(true, monkeypatch):
    """A spring of 5 % of gravity's moment exceeds it; without it the shape of the gain alone would."""
    step = with_gain(true, 1)
    made, rig = driven(true, 2)
    windows = segment_recording(made, rig, nodes=100)

    def exceeds() -> bool:
        found = predict_windows(step, step.scored.fit.theta, step.problem, windows, fitted=True).predictions
        return found.excess(np.random.default_rng(3))[0] > MAX_REDUCED_CHI2

    assert exceeds() == (true is SPRING)
    monkeypatch.setattr(held_out, "with_typical_errors", lambda noise, hypothesis: noise)
    assert exceeds()


@pytest.mark.slow
def test_a_gain_that_fades_is_named_alone():
    verdict = diagnose(*driven(ROD, 1)).verdict
    assert verdict.headline == "found"
    assert [(effect.name, effect.part) for effect in verdict.effects] == [("actuator_gain", "drive")]
    assert verdict.unknown.p_value >= P_VALUE
    assert not verdict.unknown.flagged
    # The mean of what is left of the gain, over torques of which most are far below the largest.
    assert GAIN * (1 - FADES) < verdict.effects[0].parameters[0].value < GAIN
