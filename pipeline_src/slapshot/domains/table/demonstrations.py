"""Demonstrations, which the table does not support because it has no arm."""

from typing import NoReturn

import numpy as np

from slapshot.config.trajectories import ScriptedHits
from slapshot.errors import InputError
from slapshot.scenes.scene import Scene

_NO_ARM = (
    "scene.domain: 'table' has no arm, so that it has no demonstrations and no swings; diagnose recordings "
    "with tracks in it, or use a domain with an arm, such as hockey"
)


def draw_task(settings: ScriptedHits, rng: np.random.Generator) -> NoReturn:
    """Not available in this domain.

    Raises:
        InputError: always.
    """
    raise InputError(_NO_ARM)


def demonstrate(scene: Scene, settings: ScriptedHits, tasks: list[dict[str, float]]) -> NoReturn:
    """Not available in this domain.

    Raises:
        InputError: always.
    """
    raise InputError(_NO_ARM)
