"""How a session is to move, whatever the rig conceals."""

from dataclasses import dataclass

import numpy as np

from slapshot.arrays import Array
from slapshot.lab.joints.rig import Rig

_WAVES = 6  # sines that are added up
_RAMP = 0.3  # s, in which they set in


@dataclass(frozen=True, eq=False)
class Excitation:
    """Of a session; joints and units as in `Rig.centre` and `Rig.swing`.

    Attributes:
        centre: (episodes, joints).
        wave: (episodes, commands, joints), 0 in the beginning.
    """

    centre: Array
    wave: Array


def draw_excitation(rig: Rig, episodes: int, seconds: float, rng: np.random.Generator) -> Excitation:
    """Sums of sines with random phases and frequencies, which set in smoothly from rest."""
    size = (episodes, len(rig.swing), _WAVES)
    low, high = np.array(rig.centre).T
    centre = rng.uniform(low, high, size[:2])
    frequency = np.exp(rng.uniform(np.log(rig.band[0]), np.log(rig.band[1]), size))
    phase, share = rng.uniform(0, 2 * np.pi, size), rng.uniform(0.5, 1.0, size)
    share *= np.array(rig.swing)[:, None] * np.sqrt(2 / (share**2).sum(-1, keepdims=True))
    times = np.arange(round(seconds / rig.clock.period)) * rig.clock.period
    angle = 2 * np.pi * frequency[..., None] * times + phase[..., None]
    rise = np.clip(times / _RAMP, 0, 1)
    rise = rise**3 * (10 - 15 * rise + 6 * rise**2)
    wave = (share[..., None] * np.sin(angle)).sum(2) * rise
    return Excitation(centre, wave.transpose(0, 2, 1).copy())
