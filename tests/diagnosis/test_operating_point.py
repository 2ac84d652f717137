"""What linearisations about one point share is simulated once, and is that of the point alone."""

from dataclasses import replace

import numpy as np
import pytest
from slapshot.diagnosis.fit.linear import STEP_ERROR, linearise, perturbations_of
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator

from .test_linear import EFFECTS, NONE, arm_situation, own_path

PARTS = "A", "B", "C", "d", "W", "psi", "spread", "halved"


@pytest.fixture
def situation(monkeypatch):
    """The arm with its scales, data, a trajectory and a count of the states that were simulated."""
    rig, segments, of, start = arm_situation(30)
    states = []
    run = Simulator.run

    def counted(self, model, x, u, force=None):
        states.append(len(x) * u.shape[1])
        return run(self, model, x, u, force)

    monkeypatch.setattr(Simulator, "run", counted)
    path = own_path(rig, Hypothesis(rig), segments, NONE, start)
    return rig, of, segments, path, states


def test_a_second_linearisation_about_the_same_point_simulates_its_own_columns_alone(situation):
    rig, of, segments, path, states = situation
    simulator, law = Simulator(rig), EFFECTS["spring"][0](of)
    linearise(simulator, Hypothesis(rig), NONE, segments, path, [STEP_ERROR])
    assert states
    states.clear()
    other = replace(segments, y=segments.y + 1)  # readings are no part of a point
    again = linearise(
        simulator, Hypothesis(rig), NONE, other, path.copy(), [STEP_ERROR, *perturbations_of([law])]
    )
    assert not states  # the column of a law is a product with the effect of a force
    fresh = linearise(
        Simulator(rig), Hypothesis(rig), NONE, other, path, [STEP_ERROR, *perturbations_of([law])]
    )
    for part in (*PARTS, "r"):
        np.testing.assert_array_equal(getattr(again.system, part), getattr(fresh.system, part))


def test_another_point_is_simulated_anew(situation):
    rig, of, segments, path, states = situation
    simulator, spring, gain = Simulator(rig), EFFECTS["spring"][0](of), EFFECTS["gain"][0](of)
    plain, with_gain = Hypothesis(rig), Hypothesis(rig, (gain,))
    points = [
        (plain, NONE, segments, path),
        (plain, NONE, segments, path + 1e-9),
        (plain, NONE, replace(segments, controls=tuple(2 * u for u in segments.controls)), path),
        (with_gain, np.array([0.1]), segments, path),
        (with_gain, np.array([0.2]), segments, path),
        (Hypothesis(rig, (EFFECTS["encoder"][0](of),)), np.array([0.2]), segments, path),
        (Hypothesis(rig, (spring,)), np.array([0.1, 0.0]), segments, path),
    ]
    for hypothesis, theta, own, trajectory in points:
        states.clear()
        found = linearise(simulator, hypothesis, theta, own, trajectory, [STEP_ERROR])
        assert states
        fresh = linearise(Simulator(rig), hypothesis, theta, own, trajectory, [STEP_ERROR])
        for part in PARTS:
            np.testing.assert_array_equal(getattr(found.system, part), getattr(fresh.system, part))


def test_a_trajectory_that_was_changed_in_place_is_another_point(situation):
    rig, _, segments, path, states = situation
    simulator = Simulator(rig)
    before = linearise(simulator, Hypothesis(rig), NONE, segments, path).predicted
    states.clear()
    path[0, 3, 0] += 0.1
    after = linearise(simulator, Hypothesis(rig), NONE, segments, path).predicted
    assert states
    assert np.abs(after - before).max() == pytest.approx(0.1)
