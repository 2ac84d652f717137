"""Stage `train`: an ensemble of one method on simulated hits, by the paper's sequence loss."""

import json
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import torch

from slapshot.adaptation.checkpoint import load_ensemble, save_ensemble
from slapshot.adaptation.data import SequenceSampler, Standardiser
from slapshot.adaptation.method import AdaptationMethod, Sizes, load_method
from slapshot.adaptation.names import PART
from slapshot.adaptation.optimise import fit
from slapshot.command import Run, stage_command
from slapshot.config.methods import EnsembleTraining, MethodSettings, TrainSettings
from slapshot.rollouts.reading import read_sequences

log = logging.getLogger("slapshot")

DEVICE_FILE = "device.json"


def produce(run: Run) -> None:
    """Write the ensemble and losses.csv (step, model, train, validation); of parts, join them."""
    if parts := parts_of(run.inputs):
        join_ensembles(parts, run.out)
        return
    settings = run.settings(TrainSettings)
    torch.set_num_threads(run.cores)
    device = choose_device()
    trained = train_ensemble(
        run.inputs["rollouts"], settings.method, settings.settings, settings.training, device
    )
    write_trained(run.out, settings.method, trained, device.type)


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


def write_trained(
    out: Path,
    name: str,
    trained: tuple[AdaptationMethod[Any], Standardiser, pd.DataFrame],
    device: str,
) -> None:
    """Write what `train_ensemble` gave, and on what kind of device."""
    method, standardiser, losses = trained
    losses.to_csv(out / "losses.csv", index=False, float_format="%.6g")
    save_ensemble(out, name, method, standardiser)
    (out / DEVICE_FILE).write_text(json.dumps({"device": device}) + "\n")


def parts_of(inputs: Mapping[str, Path]) -> list[Path]:
    """Folders of ensembles that are to be joined; none where one is to be trained."""
    numbers = sorted(int(role.removeprefix(PART)) for role in inputs if role.startswith(PART))
    return [inputs[f"{PART}{number}"] for number in numbers]


def join_ensembles(parts: Sequence[Path], out: Path) -> None:
    """Write the ensemble of all models of some ensembles, trained on the same rollouts, in their order."""
    ensembles = [load_ensemble(part) for part in parts]
    first, standardiser = ensembles[0]
    models = [method.models for method, _ in ensembles]
    joined = type(first)(first.sizes, first.settings, sum(models), torch.Generator().manual_seed(0))
    states = [method.state_dict() for method, _ in ensembles]
    # The first axis of every tensor is that of models.
    joined.load_state_dict({name: torch.cat([state[name] for state in states]) for name in states[0]})
    tables = [pd.read_csv(part / "losses.csv") for part in parts]
    losses = pd.concat(
        table.assign(model=table["model"] + sum(models[:k])) for k, table in enumerate(tables)
    ).sort_values(["step", "model"])
    name = json.loads((parts[0] / "ensemble.json").read_text())["method"]
    devices = {json.loads((part / DEVICE_FILE).read_text())["device"] for part in parts}
    write_trained(out, name, (joined, standardiser, losses), " and ".join(sorted(devices)))


def choose_device() -> torch.device:
    """A GPU where there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


if __name__ == "__main__":
    stage_command("train", produce)
