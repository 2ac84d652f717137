"""Pushes that come back: in most episodes, or where a link is at one place."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from slapshot.diagnosis.selection.recurrence import recurring_pushes
from slapshot.diagnosis.selection.steps import Step
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse
from slapshot.effects.joints.spring import Spring

from .mechanisms import PENDULUM
from .test_linear import arm_situation

NODES, INTERVAL = 200, 0.01


def swinging(episodes: int) -> Step:
    """A rod that swings in each of some episodes, each with a phase of its own."""
    time = np.arange(NODES) * INTERVAL
    phase = np.random.default_rng(1).uniform(0, 2 * np.pi, episodes)
    state = np.zeros((episodes, NODES, 2))
    state[..., 0] = 1.2 * np.sin(2 * np.pi * 0.7 * time + phase[:, None])
    segments = SimpleNamespace(
        episode=np.arange(episodes), ids=np.arange(episodes), time=np.tile(time, (episodes, 1)),
        inside=np.ones((episodes, NODES), bool),
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    problem = SimpleNamespace(segments=segments, rig=SimpleNamespace(model=model))
    scored = SimpleNamespace(fit=SimpleNamespace(trajectory=state))
    return Step(problem, scored, None)


def pushes(times: list[tuple[int, float]]) -> ExternalPulse:
    joint = arm_situation()[2].joints[0]
    return ExternalPulse(joint, [Pulse(e, e / 20 - 0.5, t - 0.03, t + 0.03) for e, t in times])


def crossing(step: Step, episode: int, angle: float) -> float:
    """When the rod first passes an angle."""
    angles = step.scored.fit.trajectory[episode, :, 0]
    return float(INTERVAL * np.abs(angles - angle).argmin())


@pytest.mark.parametrize(
    ("episodes", "pushed", "recurring"),
    [(8, [0, 1, 2, 3, 4], True), (8, [0, 1, 2, 3], False), (8, [0] * 5, False), (3, [0, 1, 2], False)],
)
def test_pushes_in_most_episodes_are_no_events(episodes, pushed, recurring):
    times = np.random.default_rng(3).uniform(0.1, 1.9, len(pushed))
    push = pushes(list(zip(pushed, times, strict=True)))
    of = arm_situation()[2]
    told = recurring_pushes(swinging(episodes), [push, *Spring.instances(of)], np.random.default_rng(2))
    assert (told is not None) == recurring
    assert told is None or "of 8 episodes" in told


def test_pushes_at_one_place_are_no_events():
    """As by an obstacle, in four of twelve episodes."""
    step = swinging(12)
    push = pushes([(e, crossing(step, e, 0.8)) for e in (1, 4, 6, 9)])
    told = recurring_pushes(step, [push], np.random.default_rng(2))
    assert told is not None
    assert "where body rod is at one place" in told


def test_pushes_at_any_time_are_at_one_place_no_more_often_than_the_level_says():
    """Of 300, at most 7 at a level of .01: more come by chance in 1 of 100 runs (Poisson, mean 3)."""
    rng, step = np.random.default_rng(5), swinging(12)
    told = 0
    for _ in range(300):
        chosen = zip(rng.permutation(12)[:4], rng.uniform(0.05, 1.9, 4), strict=True)
        push = pushes([(int(e), float(t)) for e, t in chosen])
        told += recurring_pushes(step, [push], rng) is not None
    assert told <= 7


def test_pushes_to_and_fro_are_one_event():
    """A push in several pieces is at one place in each, of course; two events are too few to say so."""
    step = swinging(12)
    at = [(e, crossing(step, e, 0.8)) for e in (1, 4)]
    pieces = pushes([*at, *((e, t + 0.02) for e, t in at), *((e, t + 0.04) for e, t in at)])
    assert recurring_pushes(step, [pieces], np.random.default_rng(2)) is None
