"""What encoders make of a motion, besides what a rig conceals: noise, jitter, steps, drift."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import lfilter

from slapshot.arrays import Array
from slapshot.lab.joints.case_specs import Colour, Condition
from slapshot.lab.joints.execution import Motion
from slapshot.lab.joints.hidden_effect import Concealed
from slapshot.lab.joints.rig import Rig

NOISE_SD = 1e-3  # rad, or m of a site
CORRELATION: dict[Colour, float] = {"white": 0.0, "ou20": 0.02, "ou100": 0.1}  # s
JITTER = 0.1  # standard deviation of sampling times, over the period
OUTLIERS, OUTLIER_SIZE = 0.01, 5.0  # share of samples, and their noise over the usual one
NOISE_GROWTH = 1.5  # of its standard deviation, from a session's first sample to the last
DRIFT = 3e-4  # rad, rms of an encoder's slow drift over a session
_DRIFTS = 4  # sines that it is made of


def read_clean(rig: Rig, motion: Motion, concealed: Sequence[Concealed], late: Array | None = None) -> Array:
    """What encoders tell without any noise, (episodes, samples, observed) in rad or m.

    Args:
        rig: that moves.
        motion: of it.
        concealed: what it conceals.
        late: (episodes, samples) s by which samples are taken late; stamps do not say so.
    """
    episodes, samples = motion.speeds.shape[:2]
    times = np.arange(samples) * rig.clock.sample + (np.zeros((episodes, 1)) if late is None else late)
    told = np.empty((episodes, samples, motion.positions.shape[2]))
    for column in range(told.shape[2]):
        joint = rig.joints[column] if column < len(rig.joints) else None
        own = [c for c in concealed if c.amplitude and c.shape.get("joint") == joint]
        when = times
        for c in own:
            when = c.kind.when(c.amplitude, c.shape, when)
        for episode in range(episodes):
            positions = motion.positions[episode, :, column]
            told[episode, :, column] = np.interp(when[episode], motion.times, positions)
        for c in own:
            told[..., column] = c.kind.read(c.amplitude, c.shape, told[..., column])
    return told


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """What chance does to a session's encoders.

    Attributes:
        late: (episodes, samples) s.
        added: (episodes, samples, observed) rad or m.
        truth: for the sealed file.
    """

    late: Array
    added: Array
    truth: dict[str, Any]


def draw_sensor_noise(
    condition: Condition, shape: tuple[int, int, int], period: float, rng: np.random.Generator
) -> SensorNoise:
    """Draw it for a session of `shape` episodes, samples and observed, with samples `period` s apart."""
    noise_rng, jitter_rng, tail_rng, drift_rng = rng.spawn(4)
    noise = _coloured(CORRELATION[condition.noise] / period, shape, noise_rng)
    truth: dict[str, Any] = {"noise_sd": NOISE_SD, "correlation_s": CORRELATION[condition.noise]}
    late, drift = np.zeros(shape[:2]), np.zeros(shape)
    if condition.cluttered:
        late = np.clip(jitter_rng.normal(0, JITTER, shape[:2]), -0.4, 0.4) * period
        noise[tail_rng.uniform(size=shape) < OUTLIERS] *= OUTLIER_SIZE
        place = np.linspace(-0.5, 0.5, shape[0] * shape[1]).reshape(*shape[:2], 1)
        grows = float(drift_rng.choice((-1.0, 1.0)))
        noise *= NOISE_GROWTH ** (grows * place)
        waves = drift_rng.uniform(2, 12, (_DRIFTS, shape[2]))  # rad over a session
        angle = waves * place[..., None] + drift_rng.uniform(0, 2 * np.pi, waves.shape)
        drift = DRIFT * np.sqrt(2 / _DRIFTS) * np.sin(angle).sum(2)
        truth |= {
            "jitter_sd_s": JITTER * period,
            "outlier_share": OUTLIERS,
            "noise_grows_by": NOISE_GROWTH**grows,
            "drift_rms": DRIFT,
        }
    return SensorNoise(late, NOISE_SD * noise + drift, truth)


def quantise(angles: Array, step: float | None) -> Array:
    """Angles as an encoder of that step tells them."""
    return angles if step is None else np.round(angles / step) * step


def _coloured(correlation: float, shape: tuple[int, int, int], rng: np.random.Generator) -> Array:
    """Of standard deviation 1; Ornstein and Uhlenbeck's process where `correlation` samples are alike."""
    white = rng.normal(size=shape)
    if correlation == 0:
        return white
    keeps = np.exp(-1 / correlation)
    white[:, 1:] *= np.sqrt(1 - keeps**2)  # the first sample is of the stationary process
    return lfilter([1.0], [1.0, -keeps], white, axis=1)
