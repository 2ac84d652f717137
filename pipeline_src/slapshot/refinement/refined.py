"""What a refined configuration says, for stages that go on from it without a person in between."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml


def refined_settings(refinement: Path, domain: str, rig: int) -> dict[str, Any]:
    """`randomisation` and `training` of rig-<rig>.yaml, for the domain of that name."""
    text = (refinement / f"rig-{rig}.yaml").read_text()
    settings: dict[str, Any] = yaml.safe_load(text)["domains"][domain]
    return settings


def narrowed(randomisation: Mapping[str, Any], refined: Mapping[str, Any]) -> dict[str, Any]:
    """The randomisation with the refined ranges in place of its own; what was not refined stays."""
    return {name: {**spec, **refined.get(name, {})} for name, spec in randomisation.items()}
