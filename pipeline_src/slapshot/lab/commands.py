"""What a session executes: safe latents, some of them several times, all in random order."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slapshot.errors import InputError
from slapshot.trajectories.motion import Motion
from slapshot.trajectories.safety import SafetyCheck

Array = NDArray[np.float64]

_TRIES_PER_COMMAND = 20


@dataclass(frozen=True, eq=False)
class Session:
    """Hits in the order of execution.

    Attributes:
        latents: (commands, latent) actions, a row a command.
        command: (hits,) row of `latents` that each hit executes.
        object_ids: of each hit.
    """

    latents: Array
    command: NDArray[np.int64]
    object_ids: tuple[str, ...]


def draw_session(
    settings: Mapping[str, Any],
    object_ids: Sequence[str],
    motion: Callable[[Array], Motion],
    latent: int,
    check: SafetyCheck,
    rng: np.random.Generator,
) -> Session:
    """Draw commands, z ~ N(0, I), and an order.

    Every object gets `hits` hits. Among them are the repeats: the same `commands` for every object,
    each `times` times. The others are commands that are executed once.

    Args:
        settings: hits, repeats: {commands, times}.
        object_ids: what is hit.
        motion: decodes a latent (latent,).
        latent: its dimensions.
        check: refuses motions that are not safe.
        rng: source of randomness.

    Raises:
        InputError: there are more repeats than hits, or too few latents are safe.
    """
    repeated, times = settings["repeats"]["commands"], settings["repeats"]["times"]
    single = settings["hits"] - repeated * times
    if single < 0:
        raise InputError(
            f"lab.repeats: {repeated} commands x {times} times are more than lab.hits = "
            f"{settings['hits']}; lower the first two or raise the last"
        )
    commands = repeated + single * len(object_ids)
    latents = _draw_safe(commands, motion, latent, check, rng)
    command: list[int] = []
    hit_objects: list[str] = []
    for i, object_id in enumerate(object_ids):
        first = repeated + i * single
        command += list(np.repeat(np.arange(repeated), times)) + list(range(first, first + single))
        hit_objects += [object_id] * settings["hits"]
    order = rng.permutation(len(command))
    return Session(
        latents=latents,
        command=np.array(command, np.int64)[order],
        object_ids=tuple(hit_objects[i] for i in order),
    )


def _draw_safe(
    count: int,
    motion: Callable[[Array], Motion],
    latent: int,
    check: SafetyCheck,
    rng: np.random.Generator,
) -> Array:
    """(count, latent) latents whose motions the check lets pass."""
    found: list[Array] = []
    for _ in range(_TRIES_PER_COMMAND * count):
        if len(found) == count:
            break
        z = rng.normal(size=latent)
        if check.report(motion(z)).safe:
            found.append(z)
    if len(found) < count:
        raise InputError(
            f"lab: only {len(found)} of {_TRIES_PER_COMMAND * count} sampled latents are safe; train "
            "the trajectory model longer or on narrower demonstrations"
        )
    return np.array(found)
