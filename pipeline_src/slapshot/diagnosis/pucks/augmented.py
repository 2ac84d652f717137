"""The scene with the effects that were found, ready to be simulated: MJCF and the effects' values."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from slapshot.diagnosis.pucks.launch.swing_error import LATENESS, JointLateness
from slapshot.diagnosis.pucks.slide.slide_model import Values
from slapshot.effects.catalogue import named
from slapshot.effects.effect import Effect
from slapshot.scenes.scene import Scene

AUGMENTED = "augmented"  # folder of a report
EFFECTS_FILE = "effects.json"


def effects_of(values: Mapping[str, Values]) -> list[tuple[Effect, Values]]:
    """Effects of a file of effects, errors of laws among them, with their values.

    Raises:
        InputError: the catalogue has no such effect.
    """
    errors = {LATENESS: JointLateness()}
    return [(errors.get(name) or named([name])[0], own) for name, own in values.items()]


def augmented_scene(scene: Scene, values: Mapping[str, Values]) -> Scene:
    """The scene with all effects in its model that act there; the others act on commands, slide or camera."""
    spec = scene.spec()
    for effect, own in effects_of(values):
        effect.edit(dict(own), spec, scene.info)
    spec.compile()  # to_xml wants a compiled spec
    return replace(scene, xml=spec.to_xml())


def write_augmented(scene: Scene, values: Mapping[str, Values], folder: Path) -> None:
    """Write scene.xml, scene.json and effects.json (effect -> parameter -> value)."""
    folder.mkdir(parents=True, exist_ok=True)
    augmented_scene(scene, values).save(folder)
    text = json.dumps({name: dict(own) for name, own in values.items()}, indent=2, sort_keys=True)
    (folder / EFFECTS_FILE).write_text(text + "\n")
