"""Stage `train`: an ensemble of one method on simulated hits, by the paper's sequence loss."""

import json
import logging
from pathlib import Path
from typing import Any

import pandas as pd
import torch

from slapshot.adaptation.checkpoint import save_ensemble
from slapshot.adaptation.data import SequenceSampler, Standardiser
from slapshot.adaptation.method import AdaptationMethod, Sizes, load_method
from slapshot.adaptation.optimise import fit
from slapshot.command import Run, stage_command
from slapshot.config.methods import EnsembleTraining, MethodSettings, TrainSettings
from slapshot.rollouts.reading import read_sequences

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write the ensemble and losses.csv (step, model, train, validation)."""
    settings = run.settings(TrainSettings)
    torch.set_num_threads(run.cores)
    device = choose_device()
    method, standardiser, losses = train_ensemble(
        run.inputs["rollouts"], settings.method, settings.settings, settings.training, device
    )
    losses.to_csv(run.out / "losses.csv", index=False, float_format="%.6g")
    save_ensemble(run.out, settings.method, method, standardiser)
    (run.out / "device.json").write_text(json.dumps({"device": device.type}) + "\n")


def train_ensemble(
    rollouts: Path, name: str, settings: MethodSettings, training: EnsembleTraining, device: torch.device
) -> tuple[AdaptationMethod[Any], Standardiser, pd.DataFrame]:
    """Train an ensemble of the method called `name`; validation conditions serve only the validation curve.

    Args:
        rollouts: version folder of the rollouts.
        name: of the method, as in the configuration.
        settings: of the method.
        training: settings of the training.
        device: on which to train.
    """
    data = read_sequences(rollouts, "train")
    standardiser = Standardiser.fit(data)
    generator = torch.Generator().manual_seed(training.seed)
    sizes = Sizes(data.state.shape[2], data.action.shape[2], data.outcome.shape[2])
    models = training.models
    method = load_method(name)(sizes, settings, models, generator).to(device)
    log.info("%s: %d models of %d parameters on %s", name, models, method.parameter_count(), device)
    sampler = SequenceSampler(data, standardiser, device)
    validation = SequenceSampler(read_sequences(rollouts, "validation"), standardiser, device)
    shape = (models, training.tasks, training.sequence, training.noise_variance_max)
    losses = fit(
        method,
        lambda: sampler.draw(*shape, generator=generator),
        validation.draw(*shape, generator=torch.Generator().manual_seed(0)),
        training.steps,
        training.learning_rate,
        name,
    )
    return method, standardiser, losses


def choose_device() -> torch.device:
    """A GPU where there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


if __name__ == "__main__":
    stage_command("train", produce)
