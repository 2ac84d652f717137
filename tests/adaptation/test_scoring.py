from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest
import torch
from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.evaluate import error_table
from slapshot.adaptation.method import AdaptationMethod, Sizes
from slapshot.adaptation.scoring import errors_against_samples


@dataclass(frozen=True)
class Mean:
    total: torch.Tensor
    count: int


class MeanMethod(AdaptationMethod[Mean]):
    """Predicts the mean of what it has seen, zero before: its errors are known in closed form."""

    def prior(self, tasks):
        return Mean(torch.zeros(self.models, tasks, self.sizes.outcome), 0)

    def update(self, belief, state, action, observed):
        return Mean(belief.total + observed, belief.count + 1)

    def predict(self, belief, state, action):
        mean = belief.total / max(belief.count, 1)
        return mean[:, :, None].expand(*state.shape[:3], self.sizes.outcome)

    def hidden(self, belief):
        return belief.total


@pytest.fixture
def method():
    return MeanMethod(Sizes(1, 1, 2), None, 3, torch.Generator())


@pytest.fixture
def standardiser():
    one = {k: torch.ones(1) for k in ("state", "action")}
    zero = {k: torch.zeros(1) for k in ("state", "action")}
    return Standardiser(
        {**zero, "outcome": torch.tensor([1.0, -1.0])}, {**one, "outcome": torch.tensor([2.0, 0.5])}
    )


def arrays(outcome):
    blank = np.zeros((*outcome.shape[:2], 1), np.float32)
    return {"state": blank, "action": blank, "outcome": outcome.astype(np.float32)}


def test_errors_are_distances_in_the_data_unit(method, standardiser):
    rng = np.random.default_rng(0)
    adapt, query = rng.normal(size=(4, 5, 2)), rng.normal(size=(4, 7, 2))
    errors = errors_against_samples(method, standardiser, arrays(adapt), arrays(query))
    assert errors.shape == (3, 4, 6)
    # Before any sample the prediction is standardised zero: the training mean.
    expected = np.linalg.norm(query - [1.0, -1.0], axis=2).mean(1)
    assert errors[0, :, 0] == pytest.approx(expected, rel=1e-5)
    mean = adapt[:, :3].mean(1)
    assert errors[1, :, 3] == pytest.approx(np.linalg.norm(query - mean[:, None], axis=2).mean(1), rel=1e-5)


def test_noise_is_added_to_what_is_adapted_to_only(method, standardiser):
    adapt, query = np.zeros((1, 2, 2)), np.zeros((1, 3, 2))
    noise = np.full((1, 2, 2), 0.5)
    errors = errors_against_samples(method, standardiser, arrays(adapt), arrays(query), noise)
    # 0.5 standardised is (1.0, 0.25) in the data's unit.
    assert errors[0, 0, 1:] == pytest.approx(np.hypot(1.0, 0.25), rel=1e-5)


def test_error_table_keeps_errors_with_their_tasks():
    errors = np.arange(2 * 3 * 4, dtype=float).reshape(2, 3, 4)
    table = error_table(errors, pd.DataFrame({"condition": [7, 8, 9]}))
    row = table.query("model == 1 and condition == 8 and samples == 2")
    assert row["error_m"].item() == errors[1, 1, 2]
