"""The part of a domain that the table lacks: there is no arm, so that nothing can be demonstrated."""

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
    """Refused.

    Raises:
        InputError: always.
    """
    raise InputError(_NO_ARM)


def demonstrate(scene: Scene, settings: ScriptedHits, tasks: list[dict[str, float]]) -> NoReturn:
    """Refused.

    Raises:
        InputError: always.
    """
    raise InputError(_NO_ARM)
