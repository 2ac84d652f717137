"""Stage `train`: an ensemble of one method on simulated hits, by the paper's sequence loss."""

import json
import logging

import torch

from slapshot.adaptation.checkpoint import save_ensemble
from slapshot.adaptation.data import SequenceSampler, Standardiser
from slapshot.adaptation.method import Sizes, load_method
from slapshot.adaptation.optimise import fit
from slapshot.command import Run, stage_command
from slapshot.rollouts.dataset import read_sequences

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write the ensemble and losses.csv (step, model, train, validation)."""
    settings, training = run.config, run.config["training"]
    torch.set_num_threads(run.cores)
    device = choose_device()
    data = read_sequences(run.inputs["rollouts"], "train")
    standardiser = Standardiser.fit(data)
    generator = torch.Generator().manual_seed(training["seed"])
    sizes = Sizes(data.state.shape[2], data.action.shape[2], data.outcome.shape[2])
    models = training["models"]
    method = load_method(settings["method"]).from_configuration(
        sizes, settings["settings"], models, generator
    )
    method.to(device)
    log.info("%s: %d models of %d parameters on %s", settings["method"], models,
             method.parameter_count(), device)  # fmt: skip
    sampler = SequenceSampler(data, standardiser, device)
    validation = SequenceSampler(read_sequences(run.inputs["rollouts"], "validation"), standardiser, device)
    shape = (models, training["tasks"], training["sequence"], training["noise_variance_max"])
    fixed = validation.draw(*shape, generator=torch.Generator().manual_seed(0))
    losses = fit(
        method,
        lambda: sampler.draw(*shape, generator=generator),
        fixed,
        training["steps"],
        training["learning_rate"],
        settings["method"],
    )
    losses.to_csv(run.out / "losses.csv", index=False, float_format="%.6g")
    save_ensemble(run.out, settings["method"], method, dict(settings["settings"]), standardiser)
    (run.out / "device.json").write_text(json.dumps({"device": device.type}) + "\n")


def choose_device() -> torch.device:
    """A GPU where there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


if __name__ == "__main__":
    stage_command("train", produce)
