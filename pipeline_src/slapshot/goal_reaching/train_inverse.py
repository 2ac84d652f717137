"""Stage `inverse`: train the inverse model of an ensemble."""

import logging

import pandas as pd
import torch

from slapshot.adaptation.data import SequenceSampler
from slapshot.command import Run, stage_command
from slapshot.config.acting import InverseSettings
from slapshot.goal_reaching.ensemble import load_believing
from slapshot.goal_reaching.inverse import Standardisation, train_inverse
from slapshot.rollouts.reading import read_sequences

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write inverse.safetensors and losses.csv (step, loss).

    Raises:
        InputError: the method has no belief, which is an input of the inverse model.
    """
    settings = run.settings(InverseSettings)
    torch.set_num_threads(run.cores)
    method, standardiser = load_believing(run.inputs["train"])
    data = read_sequences(run.inputs["rollouts"], "train")
    sampler = SequenceSampler(data, standardiser, torch.device("cpu"))
    action = Standardisation(standardiser.mean["action"], standardiser.scale["action"])
    generator = torch.Generator().manual_seed(settings.seed)
    inverse, losses = train_inverse(method, sampler, action, settings.inverse, settings.training, generator)
    inverse.save(run.out)
    table = pd.DataFrame({"step": range(len(losses)), "loss": losses})
    table.to_csv(run.out / "losses.csv", index=False, float_format="%.6g")
    log.info("expected squared distance: %.3g, then %.3g (standardised)", losses[0], losses[-1])


if __name__ == "__main__":
    stage_command("inverse", produce)
