"""The models of the configuration as a JSON schema: what is tracked is what they say."""

import json
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel
from slapshot.config.__main__ import schema_text
from slapshot.config.configuration import Configuration
from slapshot.config.domain import Domain
from slapshot.config.files import load_config
from slapshot.config.lab import Lab
from slapshot.config.layers import merge
from slapshot.config.randomisation import CONDITION_PARAMETERS, Draws, Randomisation
from slapshot.config.scene import HockeyScene
from slapshot.config.trajectories import Demonstrations, Pool
from slapshot.scenes.domain import build_scene
from slapshot.yaml_file import read_yaml

ROOT = Path(__file__).parents[2]
SCHEMA = ROOT / "workflow/schemas/config.schema.yaml"


def test_the_tracked_schema_is_that_of_the_models():
    remedy = "run: python -m slapshot.config schema > workflow/schemas/config.schema.yaml"
    assert SCHEMA.read_text() == schema_text(), remedy


def test_the_schema_is_a_mapping_that_refuses_unknown_keys():
    schema = read_yaml(SCHEMA)
    parts = [schema, *schema["$defs"].values()]
    open_parts = [part for part in parts if part.get("additionalProperties") is not False]
    assert open_parts == [schema["$defs"]["OwnScene"]]


def every_field(model: type[BaseModel], found: dict[str, Any]) -> dict[str, Any]:
    for name, field in model.model_fields.items():
        found[f"{model.__name__}.{name}"] = field
        for inner in _models(field.annotation):
            every_field(inner, found)
    return found


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]


def test_every_key_says_what_it_means():
    fields = every_field(Configuration, {})
    assert len(fields) > 150
    assert [name for name, field in fields.items() if not (field.description or "").strip()] == []


def _numbers(schema: Any) -> list[dict[str, Any]]:
    if isinstance(schema, list):
        return [number for part in schema for number in _numbers(part)]
    if not isinstance(schema, dict):
        return []
    own = [schema] if schema.get("type") in ("integer", "number") else []
    return own + [number for part in schema.values() for number in _numbers(part)]


def test_every_number_has_a_lowest_and_a_highest_value():
    numbers = _numbers(read_yaml(SCHEMA))
    assert len(numbers) > 100
    for number in numbers:
        assert {"minimum", "exclusiveMinimum"} & set(number), number
        assert {"maximum", "exclusiveMaximum"} & set(number), number


@pytest.mark.parametrize("name", ["default", "tiny", "paper"])
def test_the_models_have_what_the_files_say(name, monkeypatch):
    """Settings are read as attributes, and are what stands in the files, whatever is left out."""
    monkeypatch.chdir(ROOT)
    said = read_yaml(ROOT / f"config/{name}.yaml")
    config = merge(read_yaml(ROOT / "config/default.yaml"), said)
    model = load_config(Path(f"config/{name}.yaml"))
    assert json.loads(model.model_dump_json(exclude_unset=True)) == config
    hidden = model.domains["hockey"].methods["kalman"].hidden
    assert list(hidden) == config["domains"]["hockey"]["methods"]["kalman"]["hidden"]
    assert isinstance(model.domains["hockey"], Domain)
    assert isinstance(model.domains["hockey"].recordings["lab"].lab, Lab)
    assert model.domains["fetchslide"].acting is None


def test_what_stands_twice_is_the_same():
    assert (
        set(Randomisation.model_fields) == set(Draws.model_fields) == {*CONDITION_PARAMETERS, "start_error"}
    )
    assert set(Demonstrations.model_fields) == set(Pool.model_fields)
    settings = HockeyScene(
        domain="hockey", puck="inline", timestep_s=0.0005, start_m=(0.55, 0.0), board_m=(3, 2)
    )
    assert len(build_scene(settings).info.joints) == HockeyScene.joints
