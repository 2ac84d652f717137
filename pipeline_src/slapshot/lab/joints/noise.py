"""Sensor model of the encoders: noise, timing jitter, quantisation, drift."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from slapshot.arrays import Array
from slapshot.json_types import JsonObject
from slapshot.lab.joints.case_spec import Colour, MeasurementCondition
from slapshot.lab.joints.execution import SimulatedMotion
from slapshot.lab.joints.hidden_effect import Concealed
from slapshot.lab.joints.rig import Rig

NOISE_SD = 1e-3  # rad, or m of a site
CORRELATION: dict[Colour, float] = {"white": 0.0, "ou20": 0.02, "ou100": 0.1}  # s
JITTER = 0.1  # standard deviation of sampling times, over the period
OUTLIERS, OUTLIER_SIZE = 0.01, 5.0  # share of samples, and their noise over the usual one
NOISE_GROWTH = 1.5  # of its standard deviation, from a session's first sample to the last
DRIFT = 3e-4  # rad, rms of an encoder's slow drift over a session
_DRIFTS = 4  # sines that it is made of


def read_clean(
    rig: Rig, motion: SimulatedMotion, concealed: Sequence[Concealed], sample_delay: Array | None = None
) -> Array:
    """Noiseless readings, (episodes, samples, observed) in rad or m.

    Args:
        rig: the rig.
        motion: its motion.
        concealed: hidden effects.
        sample_delay: (episodes, samples) s by which samples are taken later than their stamps.
    """
    episodes, samples = motion.speeds.shape[:2]
    times = np.arange(samples) * rig.clock.sample + (
        np.zeros((episodes, 1)) if sample_delay is None else sample_delay
    )
    readings = np.empty((episodes, samples, motion.positions.shape[2]))
    for column in range(readings.shape[2]):
        joint = rig.joints[column] if column < len(rig.joints) else None
        own = [c for c in concealed if c.amplitude and c.shape.get("joint") == joint]
        when = times
        for c in own:
            when = c.effect.when(c.amplitude, c.shape, when)
        for episode in range(episodes):
            positions = motion.positions[episode, :, column]
            readings[episode, :, column] = np.interp(when[episode], motion.times, positions)
        for c in own:
            readings[..., column] = c.effect.read(c.amplitude, c.shape, readings[..., column])
    return readings


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """Sensor noise of a session.

    Attributes:
        sample_delay: (episodes, samples) s.
        added: (episodes, samples, observed) rad or m.
        truth: for the sealed file.
    """

    sample_delay: Array
    added: Array
    truth: JsonObject


def draw_sensor_noise(
    condition: MeasurementCondition, shape: tuple[int, int, int], period: float, rng: np.random.Generator
) -> SensorNoise:
    """Draw the noise of a session of `shape` (episodes, samples, observed), with samples `period` s apart."""
    noise_rng, jitter_rng, tail_rng, drift_rng = rng.spawn(4)
    noise = _coloured(CORRELATION[condition.noise] / period, shape, noise_rng)
    truth: JsonObject = {"noise_sd": NOISE_SD, "correlation_s": CORRELATION[condition.noise]}
    sample_delay, drift = np.zeros(shape[:2]), np.zeros(shape)
    if condition.cluttered:
        sample_delay = np.clip(jitter_rng.normal(0, JITTER, shape[:2]), -0.4, 0.4) * period
        noise[tail_rng.uniform(size=shape) < OUTLIERS] *= OUTLIER_SIZE
        session = np.linspace(-0.5, 0.5, shape[0] * shape[1]).reshape(*shape[:2], 1)
        grows = float(drift_rng.choice((-1.0, 1.0)))
        noise *= NOISE_GROWTH ** (grows * session)
        waves = drift_rng.uniform(2, 12, (_DRIFTS, shape[2]))  # rad over a session
        angle = waves * session[..., None] + drift_rng.uniform(0, 2 * np.pi, waves.shape)
        drift = DRIFT * np.sqrt(2 / _DRIFTS) * np.sin(angle).sum(2)
        truth |= {
            "jitter_sd_s": JITTER * period,
            "outlier_share": OUTLIERS,
            "noise_grows_by": NOISE_GROWTH**grows,
            "drift_rms": DRIFT,
        }
    return SensorNoise(sample_delay, NOISE_SD * noise + drift, truth)


def quantise(angles: Array, step: float | None) -> Array:
    """Angles quantised to an encoder's step."""
    return angles if step is None else np.round(angles / step) * step


def _coloured(correlation: float, shape: tuple[int, int, int], rng: np.random.Generator) -> Array:
    """Of standard deviation 1; Ornstein and Uhlenbeck's process where `correlation` samples are alike."""
    white = rng.normal(size=shape)
    if correlation == 0:
        return white
    keeps = np.exp(-1 / correlation)
    white[:, 1:] *= np.sqrt(1 - keeps**2)  # the first sample is of the stationary process
    return lfilter([1.0], [1.0, -keeps], white, axis=1)
