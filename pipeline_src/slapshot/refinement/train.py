"""Stage `refined_train`: an ensemble trained on refined rollouts, with noise up to the refined level."""

from pathlib import Path

import torch

from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.train import (
    choose_device,
    join_ensembles,
    parts_of,
    train_ensemble,
    write_trained,
)
from slapshot.command import Run, stage_command
from slapshot.config.methods import EnsembleTraining
from slapshot.config.refinement import RefinedTrainSettings
from slapshot.refinement.refined import refined_settings
from slapshot.rollouts.reading import read_sequences


def produce(run: Run) -> None:
    """Write the ensemble and losses.csv (step, model, train, validation); of parts, join them."""
    if parts := parts_of(run.inputs):
        join_ensembles(parts, run.out)
        return
    told = run.settings(RefinedTrainSettings)
    torch.set_num_threads(run.cores)
    refined = refined_settings(run.inputs["refinement"], told.name, told.rig).training
    scale = _narrower(run.inputs["train"], run.inputs["rollouts"])
    noise = refined.noise_variance_max * scale
    training = EnsembleTraining.from_parts(told.training, noise_variance_max=noise)
    device = choose_device()
    write_trained(
        run.out,
        told.method,
        train_ensemble(run.inputs["rollouts"], told.method, told.settings, training, device),
        device.type,
    )


def _narrower(trained: Path, rollouts: Path) -> float:
    """Variance of the outcomes that the first ensemble was trained on, over that of the refined rollouts.

    Noise is in units of standardised outcomes, which differ between the two.
    """
    before = load_ensemble(trained)[1].scale["outcome"]
    after = Standardiser.fit(read_sequences(rollouts, "train")).scale["outcome"]
    return float((before / after).square().mean())


if __name__ == "__main__":
    stage_command("refined_train", produce)
