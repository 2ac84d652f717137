"""Which pairs of effects are fitted to all segments."""

from dataclasses import replace
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


def pairs_of(count: int) -> list[SimpleNamespace]:
    """Pairs of a number and itself."""
    return [SimpleNamespace(added=[(k, None)] * 2) for k in range(count)]


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

    def refitted(before: Step, added: list[tuple[int, None]], leader: list[float], of: np.ndarray) -> tuple:
        (pair, _), _ = added
        seen.append((pair, len(of)))
        found = [WITHOUT - 5.0, WITHOUT + gains[pair] / 4] if np.isfinite(gains[pair]) else []
        return None, None, found

    monkeypatch.setattr(pair_search, "_refit_by_law_error", refitted)
    monkeypatch.setattr(pair_search, "least_worth", lambda windows, segments: 0.0)
    pairs = pairs_of(len(gains))
    assert _preselected(step(48), None, pairs, least) == [pairs[k] for k in left]
    assert seen == [(pair, some) for pair in range(len(gains))]


@pytest.mark.parametrize(("alone", "left"), [([99.0, 101.0], 2), ([99.0, 103.0], 0), ([], 2)])
def test_no_pair_is_fitted_to_all_where_one_effect_alone_explains_more(monkeypatch, alone, left):
    """On the same segments and in the same way, and early given up where it falls far behind."""
    asked = []

    def refitted(before: Step, added: list, leader: list[float], some: np.ndarray) -> tuple:
        asked.append((added, leader))
        of_pair = [WITHOUT + 101.0, WITHOUT + 102.0]
        return None, None, of_pair if len(added) == 2 else [WITHOUT + gain for gain in alone]

    monkeypatch.setattr(pair_search, "_refit_by_law_error", refitted)
    monkeypatch.setattr(pair_search, "least_worth", lambda windows, segments: 0.0)
    monkeypatch.setattr(pair_search, "one_step_values", lambda scored, i, values: (i, values))
    before, pairs = step(48), pairs_of(2)
    names = [SimpleNamespace(key=key) for key in ("pull", "rub", "drag")]
    before.scored.effects, before.scored.gains = names, [SimpleNamespace(values=k) for k in range(3)]
    single = Step(before.problem, None, None, added=SimpleNamespace(key="rub"))
    assert _preselected(before, single, pairs, 10.0) == pairs[:left]
    assert asked[-1] == ([(names[1], (1, 1))], [WITHOUT + 101.0, WITHOUT + 102.0])
    # What has no columns, as a push, and what no step adds, cannot be compared.
    for other in (None, replace(single, added=SimpleNamespace(key="push")), replace(single, added=None)):
        asked.clear()
        assert _preselected(before, other, pairs, 10.0) == pairs
        assert len(asked) == 2


def test_few_segments_are_all_fitted(monkeypatch):
    monkeypatch.setattr(pair_search, "_refit_by_law_error", None)
    assert _preselected(step(23), None, [0, 1], 100.0) == [0, 1]


@pytest.mark.parametrize(("backward", "there"), [(0.2, True), (0.0, False)])
def test_a_pair_whose_friction_is_gone_in_one_direction_is_none(backward, there):
    rig, _, of, _ = arm_situation(20)
    viscous, direction = (next(iter(kind.instances(of))) for kind in (ViscousFriction, DirectionFriction))
    hypothesis = Hypothesis(rig, (viscous, direction))
    fit = SimpleNamespace(hypothesis=hypothesis, theta=np.array([0.1, 0.3, backward]))
    pairs = (_Pair(*both, np.zeros(1), np.zeros(1)) for both in ((viscous, direction), (direction, viscous)))
    assert [_describe(fit, pair) for pair in pairs] == [there, there]
