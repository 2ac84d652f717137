"""Which pairs of effects are fitted to all segments."""

from types import SimpleNamespace

import numpy as np
import pytest
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.selection import pair_search
from slapshot.diagnosis.selection.pair_search import _describe, _Pair, _preselected
from slapshot.diagnosis.selection.steps import Step
from slapshot.effects.joints.direction_friction import DirectionFriction
from slapshot.effects.joints.viscous_friction import ViscousFriction

from .test_linear import arm_situation

WITHOUT = 1000.0  # evidence of the subset without a pair


def step(segments: int) -> Step:
    """A step of so many segments, whose fits of the step itself have no gain."""
    fitted = SimpleNamespace(log_evidence=WITHOUT)
    fitter = SimpleNamespace(fit=lambda *a, **k: fitted, segments=None)
    fitter.select = lambda some: fitter
    noise = SimpleNamespace(set_aside=None)
    noise.select = lambda some: noise
    trajectory = np.zeros((segments, 1, 1))
    fit = SimpleNamespace(hypothesis=None, theta=None, trajectory=trajectory)
    scored = SimpleNamespace(residual_noise=noise, fit=fit, system=SimpleNamespace(select=lambda some: None))
    problem = SimpleNamespace(segments=SimpleNamespace(shape=(segments, 100)), fitter=fitter)
    return Step(problem, scored, None)


@pytest.mark.parametrize(
    ("gains", "least", "left"),
    [
        ([400.0, 371.0, 369.0], 100.0, [0, 1]),  # near the best, by 30 nats
        ([10000.0, 9801.0, 9799.0], 100.0, [0, 1]),  # or by a fiftieth
        ([51.0, 20.0], 100.0, [0]),  # with less than is asked for, as other segments may tell more
        ([49.0, -np.inf], 100.0, []),  # far from it, as where one effect alone explains more
    ],
)
def test_pairs_that_explain_too_little_of_some_segments_are_not_fitted_to_all(
    monkeypatch, gains, least, left
):
    some = 12  # of 48 segments, a quarter
    seen: list[tuple[int, int]] = []

    def refit_pair(before: Step, pair: int, leader: list[float], of: np.ndarray) -> tuple:
        seen.append((pair, len(of)))
        found = [WITHOUT - 5.0, WITHOUT + gains[pair] / 4] if np.isfinite(gains[pair]) else []
        return None, None, found

    monkeypatch.setattr(pair_search, "_refit_pair", refit_pair)
    monkeypatch.setattr(pair_search, "least_worth", lambda windows, segments: 0.0)
    assert _preselected(step(48), list(range(len(gains))), least) == left
    assert seen == [(pair, some) for pair in range(len(gains))]


def test_few_segments_are_all_fitted(monkeypatch):
    monkeypatch.setattr(pair_search, "_refit_pair", None)
    assert _preselected(step(23), [0, 1], 100.0) == [0, 1]


@pytest.mark.parametrize(("backward", "there"), [(0.2, True), (0.0, False)])
def test_a_pair_whose_friction_is_gone_in_one_direction_is_none(backward, there):
    rig, _, of, _ = arm_situation(20)
    viscous, direction = (next(iter(kind.instances(of))) for kind in (ViscousFriction, DirectionFriction))
    hypothesis = Hypothesis(rig, (viscous, direction))
    fit = SimpleNamespace(hypothesis=hypothesis, theta=np.array([0.1, 0.3, backward]))
    pairs = (_Pair(*both, np.zeros(1), np.zeros(1)) for both in ((viscous, direction), (direction, viscous)))
    assert [_describe(fit, pair) for pair in pairs] == [there, there]
