"""Camera noise: how large, how long its memory; and frames in which something else was tracked."""

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OUTLIER = 5.0  # sd from the median of its neighbours
LEAP = 0.01  # m beyond noise


@dataclass(frozen=True)
class CameraNoise:
    """An Ornstein-Uhlenbeck process along each axis: covariance sd^2 exp(-|dt| / time).

    Attributes:
        sd: m.
        time: s; 0 for white noise.
    """

    sd: float
    time: float

    def whiten(self, values: Array, times: Array, valid: NDArray[np.bool_]) -> Array:
        """Innovations of the process over its sd, of unit variance if `values` are such noise.

        Args:
            values: (n, frames, 2 or more) in m; columns beyond the second are whitened alike.
            times: (n, frames) s.
            valid: (n, frames); others must be at the end, and become 0.
        """
        shape = values.shape[:2] + (1,) * (values.ndim - 2)
        white = values / self.sd
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
