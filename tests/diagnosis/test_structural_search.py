"""Which models with hidden states are fitted to all segments."""

from types import SimpleNamespace

import numpy as np
import pytest
from slapshot.diagnosis.fit.fit import Fit
from slapshot.diagnosis.fit.noise import Noise
from slapshot.diagnosis.selection import structural_search
from slapshot.diagnosis.selection.steps import Step
from slapshot.diagnosis.selection.structural_search import _not_hopeless, _white_equivalent


def test_noise_without_correlation_is_as_large_and_so_are_its_outliers():
    one, weight = np.ones(1), np.array([[[1.0], [50.0]]])
    noise = Noise(1e-5 * one, 1e-3 * one, 0.1 * one, 1e-3, one, np.ones(2), weight)
    white = _white_equivalent(noise)
    assert white.coloured == pytest.approx([0.0])
    assert white.variance.ravel() == pytest.approx([1e-6 + 1e-10, 1e-6 + 50e-10], rel=1e-9)


@pytest.mark.parametrize("behind", [-50.0, 99.0, 101.0])
def test_what_is_far_behind_a_law_on_some_segments_is_not_fitted_to_all(monkeypatch, behind):
    fit = Fit(None, np.zeros(0), np.arange(5.0)[:, None, None], 0.0, np.zeros((0, 0)), True, 0.0)
    part = SimpleNamespace(select=lambda some: some)
    problem = SimpleNamespace(fitter=part, quantities=())
    law = Step(problem, SimpleNamespace(fit=fit, noise=part), None)
    some, level, said = np.array([1, 3]), 1000.0, list[str]()

    def evidence_of_law(fitter, quantities, fit, noise):
        assert fitter is some
        assert noise is some
        assert fit.trajectory.ravel() == pytest.approx([1.0, 3.0])
        return level, fit, noise

    def evidence_of(candidate, fitter, fit, of):
        assert fitter is of is some
        return candidate.evidence, fit, None

    monkeypatch.setattr(structural_search, "_refitted_evidence", evidence_of_law)
    monkeypatch.setattr(structural_search, "_evidence_of", evidence_of)
    effect = SimpleNamespace(key="backlash@elbow")
    candidates = [
        SimpleNamespace(problem=problem, fit=fit, effect=effect, evidence=evidence)
        for evidence in (level, level - behind)
    ]
    near = _not_hopeless(candidates, law, some, said.append)
    assert near == (candidates if behind < 100 else candidates[:1])
    assert said == (
        [] if behind < 100 else ["not refitted: backlash@elbow, 101 nats behind on some segments"]
    )
