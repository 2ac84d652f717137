"""Camera noise: how large, how long its memory; and frames in which something else was tracked."""

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array

OUTLIER = 5.0  # sd from the median of its neighbours
LEAP = 0.01  # m beyond noise
MANY = 200  # frames, for an estimate of jitter


@dataclass(frozen=True)
class CameraNoise:
    """An Ornstein-Uhlenbeck process along each axis: covariance s s' exp(-|dt| / time), s the frames' sd.

    Attributes:
        sd: m, of an object at rest.
        time: s; 0 for white noise.
        jitter: s, of when a frame was really taken: an object that moves at v is seen with
            s^2 = sd^2 + (jitter v)^2.
    """

    sd: float
    time: float
    jitter: float = 0.0

    def sd_at(self, speeds: Array) -> Array:
        """The frames' sd in m at speeds in m/s."""
        return np.hypot(self.sd, self.jitter * speeds)

    def whiten(self, values: Array, times: Array, valid: NDArray[np.bool_], sd: Array) -> Array:
        """Innovations of the process over its sd, of unit variance if `values` are such noise.

        Args:
            values: (n, frames, 2 or more) in m; columns beyond the second are whitened alike.
            times: (n, frames) s.
            valid: (n, frames); others must be at the end, and become 0.
            sd: (n, frames) m, see `sd_at`.
        """
        shape = values.shape[:2] + (1,) * (values.ndim - 2)
        white = values / sd.reshape(shape)
        if self.time > 0:
            gap = np.diff(times, axis=1)
            memory = np.exp(-np.maximum(gap, 1e-6) / self.time).reshape(shape[0], -1, *shape[2:])
            white[:, 1:] = (white[:, 1:] - memory * white[:, :-1]) / np.sqrt(1 - memory**2)
        return white * valid.reshape(shape)


def estimate_noise(residuals: Array, intervals: Array) -> CameraNoise:
    """From residuals (m, 2) at rest and intervals (m,) as in `HitTracks.resting`.

    The memory comes from the correlation of neighbours at the usual interval.
    """
    sd = float(1.4826 * np.median(np.abs(residuals)))
    # A few mistracks are left out; the rest tells the variance better than the median does.
    core = residuals[(np.abs(residuals) < 4 * sd).all(1)]
    sd = float(np.sqrt((core**2).mean()))
    usual = float(np.median(intervals[np.isfinite(intervals)]))
    near = np.flatnonzero(np.abs(intervals - usual) < 0.3 * usual)
    good = (np.abs(residuals[near]) < 4 * sd).all(1) & (np.abs(residuals[near - 1]) < 4 * sd).all(1)
    near = near[good]
    correlation = float((residuals[near] * residuals[near - 1]).mean() / sd**2)
    # Standard error of a correlation is 1 / sqrt(pairs); a mean that was taken out lowers it by 1 / frames.
    if correlation < 3 / np.sqrt(2 * max(len(near), 1)):
        return CameraNoise(sd, 0.0)
    return CameraNoise(sd, float(-usual / np.log(min(correlation, 0.95))))


def outliers(residuals: Array, valid: NDArray[np.bool_], sd: float) -> NDArray[np.bool_]:
    """(n, frames) frames that jump away from both neighbours: mistracks, not missing physics.

    Args:
        residuals: (n, frames, 2) m from any smooth fit, be it a bad one.
        valid: (n, frames).
        sd: m, of the camera's noise.
    """
    padded = np.where(valid[..., None], residuals, np.nan)
    padded = np.pad(padded, ((0, 0), (2, 2), (0, 0)), constant_values=np.nan)
    window = np.stack([padded[:, i : i + residuals.shape[1]] for i in range(5)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # columns of NaN behind the last frame
        middle = np.nanmedian(window, axis=0)
    jump = np.abs(residuals - middle) > OUTLIER * sd
    return jump.any(-1) & valid


def leaps(places: Array, valid: NDArray[np.bool_], sd: float) -> NDArray[np.bool_]:
    """(n, frames) frames far from where their neighbours on either side say that the object is.

    For a first fit: finer than LEAP only a fit can tell, and no motion bends as much within a frame.

    Args:
        places: (n, frames, 2) m.
        valid: (n, frames); others must be at the end.
        sd: m, of the camera's noise.
    """
    p = np.where(valid[..., None], places, np.nan)
    p = np.pad(p, ((0, 0), (2, 2), (0, 0)), constant_values=np.nan)
    frames = places.shape[1]
    before2, before, after, after2 = (p[:, k : k + frames] for k in (0, 1, 3, 4))
    said = np.stack([2 * before - before2, (before + after) / 2, 2 * after - after2])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        middle = np.nanmedian(said, axis=0)
    # The scatter of an extrapolation is sqrt(6) times that of a frame.
    return ((np.abs(places - middle) > LEAP + OUTLIER * np.sqrt(6) * sd).any(-1)) & valid


def frame_speeds(times: Array, places: Array, valid: NDArray[np.bool_]) -> Array:
    """(n, frames) m/s, over two frames to either side; at the ends over those that there are."""
    count = valid.sum(1)[:, None]
    frames = np.arange(times.shape[1])
    low = np.maximum(frames - 2, 0)
    high = np.maximum(np.minimum(frames + 2, count - 1), low + 1)
    high = np.minimum(high, times.shape[1] - 1)
    rows = np.arange(len(times))[:, None]
    moved = np.linalg.norm(places[rows, high] - places[:, low], axis=-1)
    gap = np.maximum(times[rows, high] - times[:, low], 1e-6)
    return np.where(frames < count, moved / gap, 0.0)


def timing_jitter(times: Array, places: Array, valid: NDArray[np.bool_], sd: float) -> float:
    """Jitter in s, from how much more places scatter about a smooth track where an object is fast.

    Third differences of evenly spaced frames along the way lose what is quadratic in time, and have 20
    times the variance of a frame. Robust; 0 where it adds less than half of the noise at rest.
    """
    usual = float(np.median(np.diff(times, axis=1)[valid[:, 1:]]))
    third = np.diff(places, n=3, axis=1)
    even = np.abs(np.diff(times, axis=1) / usual - 1) < 0.3
    good = valid[:, 3:] & even[:, :-2] & even[:, 1:-1] & even[:, 2:]
    speed = frame_speeds(times, places, valid)[:, 1:-2]
    way = places[:, 3:] - places[:, :-3]
    way /= np.linalg.norm(way, axis=-1, keepdims=True) + 1e-9
    values, speeds = np.abs((third * way).sum(-1))[good], speed[good]
    if len(speeds) < MANY:
        return 0.0
    fast, slow = speeds > np.quantile(speeds, 0.75), speeds < np.quantile(speeds, 0.25)
    spread = [1.4826 * np.median(values[part]) / np.sqrt(20) for part in (fast, slow)]
    square = (spread[0] ** 2 - spread[1] ** 2) / (np.median(speeds[fast]) ** 2 - np.median(speeds[slow]) ** 2)
    jitter = float(np.sqrt(max(square, 0.0)))
    return jitter if jitter * np.median(speeds[fast]) > sd / 2 else 0.0
