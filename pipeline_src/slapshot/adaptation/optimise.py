"""The training loop shared by all stages: Adam on the paper's sequence loss."""

import logging
from collections.abc import Callable
from typing import Any

import pandas as pd
import torch

from slapshot.adaptation.data import Batch
from slapshot.adaptation.method import AdaptationMethod
from slapshot.progress import progress

log = logging.getLogger("slapshot")

_VALIDATIONS = 20  # points of the validation curve
_GRADIENT_NORM = 5.0  # clipping threshold of one model; only the first steps and a rare batch reach it


def fit(
    method: AdaptationMethod[Any],
    draw: Callable[[], Batch],
    validation: Batch,
    steps: int,
    learning_rate: float,
    name: str,
) -> pd.DataFrame:
    """Train all models of an ensemble at once (paper, algorithm 1 and eq. loss).

    Args:
        method: the ensemble, trained in place.
        draw: returns the batch of the next step.
        validation: held-out batch of the validation curve.
        steps: number of gradient steps.
        learning_rate: the peak of a one-cycle schedule.
        name: of the model that is trained, for the progress report.

    Returns:
        Losses by step, model: train, validation (mean squared error, standardised).
    """
    optimiser = torch.optim.Adam(method.parameters(), lr=learning_rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, learning_rate, total_steps=steps, pct_start=0.1)
    rows = []
    every = max(1, steps // _VALIDATIONS)
    for step in progress(range(steps), steps, f"training {name}"):
        batch = draw()
        predictions = method.sequence_predictions(batch.state, batch.action, batch.observed)
        loss = method.sequence_loss(predictions, batch.outcome)
        optimiser.zero_grad()
        loss.backward()
        clip_gradients(method, _GRADIENT_NORM)
        optimiser.step()
        schedule.step()
        if step % every == 0 or step == steps - 1:
            with torch.no_grad():
                predicted = method.sequence_predictions(
                    validation.state, validation.action, validation.observed
                )
                held_out = method.model_losses(predicted, validation.outcome).tolist()
                trained = method.model_losses(predictions, batch.outcome).tolist()
            rows += [
                {"step": step, "model": i, "train": t, "validation": v}
                for i, (t, v) in enumerate(zip(trained, held_out, strict=True))
            ]
    log.info("validation loss %s", [round(v, 4) for v in held_out])
    return pd.DataFrame(rows)


def clip_gradients(method: AdaptationMethod[Any], largest: float) -> None:
    """Clip the gradient of each model to the norm `largest`.

    Torch's own function would take the norm over all models, so that one model's bad batch would shorten
    the steps of the others.
    """
    gradients = [p.grad for p in method.parameters() if p.grad is not None]
    norm = torch.cat([g.reshape(len(g), -1) for g in gradients], dim=1).norm(dim=1)
    scale = (largest / norm).clamp(max=1.0)
    for gradient in gradients:
        gradient.mul_(scale.view(-1, *[1] * (gradient.dim() - 1)))
