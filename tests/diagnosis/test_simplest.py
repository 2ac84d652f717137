"""Of rivals that act alike the one with the fewest parameters, if it explains nearly as much."""

from types import SimpleNamespace

import numpy as np
import pytest
from slapshot.diagnosis.selection import simplest as module
from slapshot.diagnosis.selection.simplest import simplest
from slapshot.diagnosis.selection.steps import Rival


def rival(parameters: int, gain: float) -> Rival:
    effect = SimpleNamespace(parameters=(None,) * parameters, friction=False, part="joint")
    return Rival(effect, gain, fit=None)


@pytest.mark.parametrize(
    ("gain", "angle", "chosen"),
    [
        (950.0, 0.1, 1),  # alike, and nearly as good
        (950.0, 0.2, 0),  # differs by a fifth
        (-5.0, 0.1, 0),  # what both have in common is the change of other effects
    ],
)
def test_a_simpler_rival_acts_alike_and_explains_as_much(monkeypatch, gain, angle, chosen):
    rivals = [rival(3, 1000.0), rival(1, gain)]
    actions = {3: np.array([[1.0, 0.0]]), 1: np.array([[np.cos(angle), np.sin(angle)]])}
    monkeypatch.setattr(module, "_velocity_change", lambda step, one: actions[len(one.effect.parameters)])
    assert simplest(None, rivals) is rivals[chosen]
