"""The training loop that all stages share: Adam on the paper's sequence loss."""

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
_GRADIENT_NORM = 10.0  # per ensemble; only the first steps reach it


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
        method: the ensemble; its weights are changed.
        draw: gives the batch of the next step.
        validation: held-out batch of the validation curve.
        steps: number of gradient steps.
        learning_rate: the peak of a one-cycle schedule.
        name: what is trained, for the progress report.

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
        torch.nn.utils.clip_grad_norm_(method.parameters(), _GRADIENT_NORM)
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
