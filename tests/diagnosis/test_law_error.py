"""Errors of the model's own laws: of unit size, and free of a change of the whole law."""

import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis.law_error import law_errors
from slapshot.diagnosis.path import recorded_path
from slapshot.diagnosis.rig import bind
from slapshot.diagnosis.segments import cut
from slapshot.diagnosis.situation import situation
from slapshot.effects.joints.effect import Situation, State

from .mechanisms import PENDULUM, joint, recording, told

SHAPES = 7


def moving(text: str, torque: float | None = None) -> tuple[Situation, State]:
    """The rod on a sine, its motor at a constant torque or at one that follows nothing."""
    t, rng = np.arange(300) * 0.01, np.random.default_rng(1)
    u = rng.normal(size=300) if torque is None else np.full(300, torque)
    made = recording(t, {"a": (joint("swing"), np.sin(5 * t)), "u": (told(actuator="drive"), u)})
    rig = bind(MjSpec.from_string(text), made.channels)
    segments = cut(made, rig)
    x = recorded_path(rig, segments)
    acting = u[: segments.inside.sum()][:, None]
    flat = x[segments.inside]
    time = segments.time[segments.inside]
    return situation(rig, segments, x), State(flat[:, :1], flat[:, 1:], acting, time, 0 * time)


def pushes(of: Situation, state: State) -> np.ndarray:
    """(looks, n) what each error does to the joint at a share of 1."""
    looks = law_errors(of, state)
    return np.array([look.effect.force(state, np.ones(1))[:, 0] for look in looks]).reshape(len(looks), -1)


def test_each_error_has_the_size_of_its_law_and_leaves_the_whole_alone():
    of, state = moving(PENDULUM)
    found = pushes(of, state)
    laws = [state.torque[:, 0], -0.05 * state.v[:, 0]]
    assert len(found) == SHAPES * len(laws)
    for law, errors in zip(laws, np.split(found, 2), strict=True):
        np.testing.assert_allclose(np.mean(errors**2, axis=1), np.mean(law**2), rtol=1e-9)
        np.testing.assert_allclose(errors @ law / (law @ law), 0, atol=1e-12)


def test_together_they_have_the_common_size():
    of, state = moving(PENDULUM)
    looks = law_errors(of, state)
    # Shares of six shapes, each with a sixth of the variance.
    assert sum(look.scale**2 for look in looks[:SHAPES]) == pytest.approx(1)
    for look in looks:
        assert look.effect.name == "law_error"
        assert look.values == (look.probe,)


@pytest.mark.parametrize(
    ("text", "laws"),
    [
        (PENDULUM.replace(' damping="0.05"', ""), 1),
        (PENDULUM, 2),
        (PENDULUM.replace('damping="0.05"', 'damping="0.05" frictionloss="0.1"'), 3),
    ],
)
def test_only_laws_that_the_model_has_can_err(text, laws):
    of, state = moving(text)
    assert len(law_errors(of, state)) == SHAPES * laws


def test_a_motor_that_does_nothing_does_not_err():
    of, state = moving(PENDULUM, 0.0)
    found = pushes(of, state)
    # Of damping there are the five shapes of speed; those of load do not vary.
    assert len(found) == 5
    assert np.all(np.mean(found**2, axis=1) > 0)


def test_what_does_not_vary_is_no_error_of_its_own():
    """A constant load: as a factor it would be a change of the whole law, blown up from rounding."""
    of, state = moving(PENDULUM, 0.7)
    law = -0.05 * state.v[:, 0]
    found = pushes(of, state)
    assert len(found) == 10
    for errors in found[5:]:
        assert abs(errors @ law / (law @ law)) < 1e-9
