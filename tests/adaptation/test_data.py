import numpy as np
import pandas as pd
import pytest
import torch
from slapshot.adaptation.data import SequenceSampler, Standardiser
from slapshot.rollouts.reading import Sequences


@pytest.fixture
def data():
    rng = np.random.default_rng(0)
    shape = (30, 20)
    return Sequences(
        state=np.full((*shape, 2), 0.55, np.float32),
        action=rng.normal(size=(*shape, 3)).astype(np.float32),
        outcome=(rng.normal(size=(*shape, 2)) * [0.3, 0.05] + [1.0, -2.0]).astype(np.float32),
        conditions=pd.DataFrame({"condition": range(30)}),
    )


def test_standardised_outcomes_have_unit_variance_and_come_back(data, tmp_path):
    standardiser = Standardiser.fit(data)
    z = standardiser.standardise("outcome", data.outcome)
    assert z.mean((0, 1)).abs().max() < 1e-5
    assert z.std((0, 1)).numpy() == pytest.approx([1, 1], rel=1e-3)
    assert standardiser.restore("outcome", z).numpy() == pytest.approx(data.outcome, abs=1e-5)
    # A start that never varies is centred, not divided by nothing.
    assert (standardiser.standardise("state", data.state) == 0).all()
    standardiser.save(tmp_path / "s.safetensors")
    again = Standardiser.load(tmp_path / "s.safetensors")
    assert torch.equal(again.scale["outcome"], standardiser.scale["outcome"])


def test_noise_has_the_variance_that_the_paper_draws(data):
    sampler = SequenceSampler(data, Standardiser.fit(data), torch.device("cpu"))
    batch = sampler.draw(4, 250, 20, 0.5, torch.Generator().manual_seed(1))
    variance = (batch.observed - batch.outcome).square().mean(2)
    # Mean of U(0, 0.5) is 0.25; the variance of a sample variance of 20 normals adds to that of the draw.
    count = variance.numel()
    spread = np.sqrt((0.5**2 / 12 + (2 / 20) * (0.5**2 / 3)) / count)
    assert variance.mean().item() == pytest.approx(0.25, abs=6 * spread)
    assert not torch.equal(variance[..., 0], variance[..., 1])


def test_a_sequence_is_of_one_condition_without_repeats(data):
    marked = Sequences(
        data.state,
        data.action,
        np.stack(np.broadcast_arrays(np.arange(30)[:, None], np.arange(20)), -1).astype(np.float32),
        data.conditions,
    )
    standardiser = Standardiser.fit(marked)
    sampler = SequenceSampler(marked, standardiser, torch.device("cpu"))
    batch = sampler.draw(2, 16, 20, 0.0, torch.Generator().manual_seed(0))
    outcome = standardiser.restore("outcome", batch.outcome).round()
    assert torch.equal(batch.observed, batch.outcome)
    assert (outcome[..., 0] == outcome[:, :, :1, 0]).all()
    assert torch.equal(outcome[..., 1].sort(-1).values, torch.arange(20.0).expand(2, 16, 20))
    assert len(outcome[:, :, 0, 0].unique()) > 10
