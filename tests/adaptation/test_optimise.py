"""The training loop: gradients are clipped model by model, and the curve is what was asked for."""

import math

import pytest
import torch
from slapshot.adaptation.data import Batch
from slapshot.adaptation.maml import Maml
from slapshot.adaptation.method import Sizes
from slapshot.adaptation.optimise import clip_gradients, fit
from slapshot.config.methods import MamlSettings

SIZES = Sizes(state=1, action=1, outcome=1)


def build(models: int = 2):
    # Has a parameter of shape (M,).
    settings = MamlSettings(batch=1, steps=2, step_size=0.1, hidden=(4,))
    return Maml(SIZES, settings, models, torch.Generator().manual_seed(0))


def batch(seed: int, models: int = 2) -> Batch:
    generator = torch.Generator().manual_seed(seed)
    state, action = (torch.randn(models, 8, 6, 1, generator=generator) for _ in range(2))
    return Batch(state, action, state + action, state + action)


def norms(method) -> list[float]:
    grads = [p.grad for p in method.parameters()]
    return [math.sqrt(sum(float(g[m].square().sum()) for g in grads)) for m in range(method.models)]


def test_only_the_model_with_the_large_gradient_is_clipped():
    method = build()
    for p in method.parameters():
        p.grad = torch.stack([torch.full(p.shape[1:], 1e-3), torch.full(p.shape[1:], 1e3)])
    before = norms(method)
    assert before[0] < 5 < before[1]
    clip_gradients(method, 5.0)
    small, large = norms(method)
    assert small == before[0]
    assert large == pytest.approx(5.0, rel=1e-5)
    directions = [p.grad[1] / p.grad[1].norm() for p in method.parameters() if p.dim() > 1]
    assert all(torch.allclose(d, d.flatten()[0].expand_as(d)) for d in directions)


def test_curve_has_a_row_a_model_and_begins_before_the_first_step():
    method, held_out = build(), batch(1)
    with torch.no_grad():
        predicted = method.sequence_predictions(held_out.state, held_out.action, held_out.observed)
    losses = fit(method, lambda: batch(2), held_out, 40, 1e-2, "test")
    assert sorted(losses["model"].unique()) == [0, 1]
    assert losses["step"].min() == 0
    assert losses["step"].max() == 39
    # A sum of two numbers is easy.
    by_step = losses.groupby("step")["train"].mean()
    assert by_step.iloc[-1] < 0.8 * by_step.iloc[0]
    # One step at a one-cycle schedule's small first rate hardly moves the held-out loss.
    first = losses[losses["step"] == 0]["validation"].to_numpy()
    start = method.model_losses(predicted, held_out.outcome).numpy()
    assert abs(first - start).max() < 0.1 * start.max()
