"""Errors by joint of laws of the swing."""

from types import SimpleNamespace

import numpy as np
import pytest
from slapshot.diagnosis.pucks.augmented import effects_of
from slapshot.diagnosis.pucks.launch.launch_model import LaunchModel
from slapshot.diagnosis.pucks.launch.swing_error import (
    LATENESS,
    JointLateness,
    error_note,
    launches_late,
    swings_late,
    with_errors,
)
from slapshot.effects.catalogue import catalogue

LATE = np.array([-0.05, 0.0, 0.05])  # s


def values(late):
    return {p.name: float(t) for p, t in zip(JointLateness.parameters, late, strict=True)}


def test_each_joint_gets_its_targets_late_by_its_own_time():
    """Ramps of other speeds: a joint that is late by t lags by its speed times t, but for the ends."""
    period, speeds = 0.01, np.arange(1.0, 8.0)
    targets = np.arange(50)[:, None] * period * speeds
    late = np.linspace(-0.03, 0.03, 7)
    moved = JointLateness().command(values(late), targets, period)
    np.testing.assert_allclose(moved[5:-5], (targets - late * speeds)[5:-5], atol=1e-12)
    np.testing.assert_array_equal(JointLateness().command(values(np.zeros(7)), targets, period), targets)


def test_a_late_joint_alone_moves_alone():
    rng = np.random.default_rng(0)
    speeds = rng.normal(size=(4, 6, 3))
    changes = swings_late(LATE, speeds)
    assert changes.shape == (3, 3, 4, 6, 3)
    np.testing.assert_allclose(changes[1, 2, ..., 1], -0.05 * speeds[..., 1])
    assert not changes[1][..., [0, 2]].any()
    assert not changes[:, 1].any()


def test_a_launch_changes_by_where_the_joint_is_and_how_fast():
    """By finite differences of an angle q(t) = a t^2 / 2 + v t about the contact at t = 0."""
    rng = np.random.default_rng(0)
    by_joints, speeds, accelerations = rng.normal(size=(4, 5, 6)), *rng.normal(size=(2, 4, 3))
    changes = launches_late(LATE, by_joints, speeds, accelerations)
    assert changes.shape == (3, 3, 4, 5)
    t = 1e-6
    offset, rate = accelerations * t**2 / 2 - speeds * t, -accelerations * t  # of joints that are late by t
    for j in range(3):
        expected = by_joints[..., j] * offset[:, [j]] + by_joints[..., 3 + j] * rate[:, [j]]
        np.testing.assert_allclose(changes[j, 2] / LATE[2], expected / t, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(
    ("names", "errs"),
    [(["tracking_lag"], True), (["servo_gain", "tilt"], True), (["tilt"], False), ([], False)],
)
def test_errors_by_joint_stand_beside_laws_with_one_value_for_all(names, errs):
    known = {**catalogue(), LATENESS: JointLateness()}
    assert with_errors(known, names) == [*names, *([LATENESS] if errs else [])]
    assert with_errors(catalogue(), names) == names


def test_a_note_says_by_how_much_joints_differ():
    known = {**catalogue(), LATENESS: JointLateness()}
    found = {"tilt": {}, "tracking_lag": {}, LATENESS: values(np.linspace(-0.002, 0.004, 7))}
    note = error_note(known, found, 7)
    assert note.startswith("beside tracking lag, which")
    assert "-2.0 to 4.0 ms" in note


def test_a_file_of_effects_may_hold_errors_of_laws():
    late = values(np.full(7, 0.01))
    found = effects_of({"tilt": {"slope_x": 0.01, "slope_y": 0.0}, LATENESS: late})
    assert [(type(effect).__name__, own) for effect, own in found][1] == ("JointLateness", late)


def test_fits_begin_at_sizes_of_one_parameter_and_where_none_is_negative_at_those_of_all():
    sizes = np.array([0.0, 0.002, 0.01])
    changes = {
        f"{effect.name}/{p.name}": SimpleNamespace(x=sizes)
        for effect in catalogue().values()
        for p in effect.parameters
    }
    model = SimpleNamespace(_effects=catalogue(), _changes=changes)
    elastic = LaunchModel.sizes(model, "joint_elasticity")
    neutral = catalogue()["joint_elasticity"].neutral()
    assert elastic[:2] == [{**neutral, "twist_1": 0.002}, {**neutral, "twist_1": 0.01}]
    assert elastic[14:] == [dict.fromkeys(neutral, 0.002), dict.fromkeys(neutral, 0.01)]
    assert len(LaunchModel.sizes(model, "camera_scale")) == 2 * 3
    assert len(LaunchModel.sizes(model, "backlash")) == 2
