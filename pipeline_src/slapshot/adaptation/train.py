"""Stage `train`: an ensemble of one method on simulated hits, by the paper's sequence loss."""

import json
import logging

import pandas as pd
import torch

from slapshot.adaptation.checkpoint import save_ensemble
from slapshot.adaptation.data import SequenceSampler, Standardiser
from slapshot.adaptation.method import Sizes, load_method
from slapshot.command import Run, stage_command
from slapshot.progress import progress
from slapshot.rollouts.dataset import read_sequences

log = logging.getLogger("slapshot")

_VALIDATIONS = 20  # points of the validation curve
_GRADIENT_NORM = 10.0  # per ensemble; only the first steps reach it


def produce(run: Run) -> None:
    """Write the ensemble and losses.csv (step, model, train, validation)."""
    settings, training = run.config, run.config["training"]
    torch.set_num_threads(run.cores)
    device = choose_device()
    data = read_sequences(run.inputs["rollouts"], "train")
    standardiser = Standardiser.fit(data)
    generator = torch.Generator().manual_seed(training["seed"])
    sizes = Sizes(data.state.shape[2], data.action.shape[2], data.outcome.shape[2])
    models, steps = training["models"], training["steps"]
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
    optimiser = torch.optim.Adam(method.parameters(), lr=training["learning_rate"])
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, training["learning_rate"], total_steps=steps, pct_start=0.1
    )
    rows = []
    every = max(1, steps // _VALIDATIONS)
    for step in progress(range(steps), steps, f"training {settings['method']}"):
        batch = sampler.draw(*shape, generator=generator)
        predictions = method.sequence_predictions(batch.state, batch.action, batch.observed)
        loss = method.sequence_loss(predictions, batch.outcome)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(method.parameters(), _GRADIENT_NORM)
        optimiser.step()
        schedule.step()
        if step % every == 0 or step == steps - 1:
            with torch.no_grad():
                predicted = method.sequence_predictions(fixed.state, fixed.action, fixed.observed)
                held_out = method.model_losses(predicted, fixed.outcome).tolist()
                trained = method.model_losses(predictions, batch.outcome).tolist()
            rows += [
                {"step": step, "model": i, "train": t, "validation": v}
                for i, (t, v) in enumerate(zip(trained, held_out, strict=True))
            ]
    losses = pd.DataFrame(rows)
    losses.to_csv(run.out / "losses.csv", index=False, float_format="%.6g")
    log.info("validation loss %s", [round(v, 4) for v in held_out])
    save_ensemble(run.out, settings["method"], method, dict(settings["settings"]), standardiser)
    (run.out / "device.json").write_text(json.dumps({"device": device.type}) + "\n")


def choose_device() -> torch.device:
    """A GPU where there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


if __name__ == "__main__":
    stage_command("train", produce)
