"""Trained ensembles on disk, as safetensors and JSON: loading one never unpickles anything."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file, save_file

from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.method import AdaptationMethod, Sizes, load_method


def save_ensemble(
    folder: Path,
    name: str,
    method: AdaptationMethod[Any],
    standardiser: Standardiser,
) -> None:
    """Write ensemble.safetensors, ensemble.json and standardiser.safetensors."""
    tensors = {key: value.detach().cpu().contiguous() for key, value in method.state_dict().items()}
    save_file(tensors, folder / "ensemble.safetensors")
    standardiser.save(folder / "standardiser.safetensors")
    description = {
        "method": name,
        "settings": dict(sorted(method.settings.model_dump(mode="json").items())),
        "sizes": asdict(method.sizes),
        "models": method.models,
        "parameters_per_model": method.parameter_count(),
    }
    (folder / "ensemble.json").write_text(json.dumps(description, indent=2) + "\n")


def load_ensemble(folder: Path) -> tuple[AdaptationMethod[Any], Standardiser]:
    """Read what `save_ensemble` wrote, ready to evaluate on the CPU."""
    raw = json.loads((folder / "ensemble.json").read_text())
    kind = load_method(raw["method"])
    settings = kind.Settings.model_validate_json(json.dumps(raw["settings"]))
    method = kind(Sizes(**raw["sizes"]), settings, raw["models"], torch.Generator().manual_seed(0))
    method.load_state_dict(load_file(folder / "ensemble.safetensors"))
    return method.eval(), Standardiser.load(folder / "standardiser.safetensors")
