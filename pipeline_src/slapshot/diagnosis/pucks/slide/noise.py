"""Camera noise: how large, how long its memory; and frames in which something else was tracked."""

import warnings
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import minimize

from slapshot.arrays import Array

OUTLIER = 5.0  # sd from the median of its neighbours
LEAP = 0.01  # m beyond noise
MANY = 200  # frames, for an estimate of jitter
CORE = 4.0  # sd beyond which a frame at rest is a mistrack
LONGEST_MEMORY = 1.0  # s; what changes more slowly is no noise of frames
SPAN = 1.6  # usual intervals on average between four frames, of which a track has no more than a parabola
SHOWN_BY = 3.0  # standard errors that a jitter must exceed
# Squares of neighbouring third differences overlap: their sum varies by 1 + 2 (.75^2 + .3^2 + .05^2) more.
OVERLAP = 2.31


@dataclass(frozen=True)
class CameraNoise:
    """White noise and an Ornstein-Uhlenbeck process along each axis.

    Attributes:
        sd: m, of an object at rest, both together.
        time: s, memory of the process; 0 for white noise alone.
        jitter: s, of when a frame was really taken: an object that moves at v is seen with
            s^2 = sd^2 + (jitter v)^2.
        coloured: share of the process in the variance at rest.
        error: relative standard error of the variance at rest.
    """

    sd: float
    time: float
    jitter: float = 0.0
    coloured: float = 1.0
    error: float = 0.0

    def sd_at(self, speeds: Array) -> Array:
        """The frames' sd in m at speeds in m/s."""
        return np.hypot(self.sd, self.jitter * speeds)

    def whiten(self, values: Array, times: Array, valid: NDArray[np.bool_], sd: Array) -> Array:
        """Innovations over their sd, of unit variance and independent if `values` are such noise.

        Args:
            values: (n, frames, 2 or more) in m; columns beyond the second are whitened alike.
            times: (n, frames) s.
            valid: (n, frames); others must be at the end, and become 0.
            sd: (n, frames) m, see `sd_at`.
        """
        shape = values.shape[:2] + (1,) * (values.ndim - 2)
        if not self.time:
            return values / sd.reshape(shape) * valid.reshape(shape)
        gaps = np.diff(times, axis=1, prepend=-np.inf)
        coloured = self.coloured * self.sd**2
        white = np.maximum(sd**2 - coloured, 0.0)
        flat = np.ascontiguousarray(values.reshape(*values.shape[:2], -1), float)
        left, _ = _innovations(flat, gaps, white, coloured, self.time)
        return left.reshape(values.shape) * valid.reshape(shape)


@njit(cache=True, nogil=True)
def _innovations(
    values: Array, gaps: Array, white: Array, coloured: float, time: float
) -> tuple[Array, Array]:
    """Of the Kalman filter of the process: (n, frames, k) over their sd, and those sd (n, frames).

    Args:
        values: (n, frames, k), each column a sequence of its own.
        gaps: (n, frames) s since the frame before; infinite where a sequence begins.
        white: (n, frames) variance of the white part.
        coloured: variance of the process.
        time: s, its memory.
    """
    count, frames, size = values.shape
    left, sd = np.empty((count, frames, size)), np.empty((count, frames))
    mean = np.empty(size)
    for i in range(count):
        mean[:] = 0.0
        variance = coloured
        for f in range(frames):
            memory = np.exp(-max(gaps[i, f], 1e-6) / time)
            variance = memory**2 * variance + (1 - memory**2) * coloured
            total = variance + white[i, f]
            gain, root = variance / total, np.sqrt(total)
            for k in range(size):
                mean[k] *= memory
                error = values[i, f, k] - mean[k]
                left[i, f, k] = error / root
                mean[k] += gain * error
            variance *= 1 - gain
            sd[i, f] = root
    return left, sd


class _RestLikelihood:
    """Likelihood of frames at rest, sequences whose means are not known (restricted likelihood)."""

    def __init__(self, residuals: Array, intervals: Array) -> None:
        self._values = np.column_stack([residuals, np.ones(len(residuals))])[None]
        self._gaps = intervals[None]
        self._starts = np.flatnonzero(np.isinf(intervals))
        self.freedom = 2 * (len(residuals) - len(self._starts))

    def of(self, variance: float, coloured: float, time: float) -> float:
        """-2 log likelihood for a variance at rest in m^2, the process's share of it, and its memory in s."""
        own = coloured * variance
        white = np.full(self._gaps.shape, variance - own)
        left, sd = _innovations(self._values, self._gaps, white, own, time)
        x, y, one = left[0].T
        sums = [np.add.reduceat(v, self._starts) for v in (x * one, y * one, one * one)]
        squares = (x**2 + y**2).sum() - ((sums[0] ** 2 + sums[1] ** 2) / sums[2]).sum()
        return float(4 * np.log(sd).sum() + 2 * np.log(sums[2]).sum() + squares)


def estimate_noise(residuals: Array, intervals: Array) -> CameraNoise:
    """From residuals (m, 2) in m at rest and intervals (m,) in s as in `HitTracks.resting`.

    White noise, or with a coloured part where that is worth its two parameters (Schwarz's criterion).
    """
    sd = float(1.4826 * np.median(np.abs(residuals)))
    if sd == 0:
        return CameraNoise(0.0, 0.0)
    # A few mistracks are left out; the rest tells the variance better than the median does. Noise may be
    # larger along one axis, as that along which a camera looks.
    each = np.maximum(1.4826 * np.median(np.abs(residuals), axis=0), sd)
    core: NDArray[np.bool_] = np.all(np.abs(residuals) < CORE * each, axis=1)
    residuals, intervals = residuals[core], _without(intervals, core)
    begins = np.isinf(intervals)
    likelihood = _RestLikelihood(residuals, intervals)
    freedom = max(likelihood.freedom, 1)
    sums = np.add.reduceat(residuals, np.flatnonzero(begins))
    lengths = np.diff([*np.flatnonzero(begins), len(begins)])
    variance = float((residuals**2).sum() - (sums**2 / lengths[:, None]).sum()) / freedom
    kurtosis = float((residuals**4).mean() / max((residuals**2).mean() ** 2, 1e-30))
    white = CameraNoise(float(np.sqrt(variance)), 0.0, error=float(np.sqrt(max(kurtosis - 1, 0) / freedom)))
    if begins.all() or not variance:
        return white
    usual = float(np.median(intervals[~begins]))

    def of(at: Array) -> tuple[float, float, float]:
        time = np.clip(np.exp(at[2]), usual / 4, LONGEST_MEMORY)
        return variance * float(np.exp(at[0])), float(1 / (1 + np.exp(-at[1]))), float(time)

    def misfit(at: Array) -> float:
        return likelihood.of(*of(at))

    starts = [np.array([0.0, share, np.log(time * usual)]) for share in (0.0, 3.0) for time in (1.0, 4.0)]
    fits = [minimize(misfit, start, method="Nelder-Mead", options={"maxiter": 200}) for start in starts]
    best = min(fits, key=lambda fit: float(fit.fun))
    if likelihood.of(variance, 0.0, usual) - float(best.fun) <= 2 * np.log(freedom):
        return white
    total, coloured, time = of(best.x)
    # Frames within a memory of each other say the same.
    error = white.error * float(np.sqrt(1 + 2 * coloured**2 * time / usual))
    return CameraNoise(float(np.sqrt(total)), time, coloured=coloured, error=error)


def _without(intervals: Array, kept: NDArray[np.bool_]) -> Array:
    """Intervals since the frame before that is kept, infinite where a sequence now begins."""
    begins = np.isinf(intervals)
    sequence, passed = np.cumsum(begins)[kept], np.cumsum(np.where(begins, 0.0, intervals))[kept]
    return np.where(np.diff(sequence, prepend=0) != 0, np.inf, np.diff(passed, prepend=0.0))


def outliers(residuals: Array, valid: NDArray[np.bool_], sd: Array) -> NDArray[np.bool_]:
    """(n, frames) frames that jump away from both neighbours: mistracks, not missing physics.

    Args:
        residuals: (n, frames, 2) m from any smooth fit, be it a bad one.
        valid: (n, frames).
        sd: (n, frames) m, of the camera's noise; larger where an object is fast and stamps jitter.
    """
    padded = np.where(valid[..., None], residuals, np.nan)
    padded = np.pad(padded, ((0, 0), (2, 2), (0, 0)), constant_values=np.nan)
    window = np.stack([padded[:, i : i + residuals.shape[1]] for i in range(5)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # columns of NaN behind the last frame
        middle = np.nanmedian(window, axis=0)
    jump = np.abs(residuals - middle) > OUTLIER * sd[..., None]
    return jump.any(-1) & valid


def leaps(times: Array, places: Array, valid: NDArray[np.bool_], sd: float) -> NDArray[np.bool_]:
    """(n, frames) frames far from where their neighbours on either side say that the object is.

    For a first fit: finer than LEAP only a fit can tell, and no motion bends as much within a frame.

    Args:
        times: (n, frames) s; frames may be lost between two.
        places: (n, frames, 2) m.
        valid: (n, frames); others must be at the end.
        sd: m, of the camera's noise.
    """
    seen = np.where(valid[..., None], np.concatenate([times[..., None], places], axis=-1), np.nan)
    padded = np.pad(seen, ((0, 0), (2, 2), (0, 0)), constant_values=np.nan)
    before2, before, after, after2 = (padded[:, k : k + places.shape[1]] for k in (0, 1, 3, 4))

    def line(one: Array, other: Array) -> Array:
        """(n, frames, 2) m at a frame's own time, on the line through two of its neighbours."""
        share = (times - one[..., 0]) / (other[..., 0] - one[..., 0])
        return one[..., 1:] + share[..., None] * (other - one)[..., 1:]

    with warnings.catch_warnings(), np.errstate(divide="ignore", invalid="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        said = np.stack([line(before2, before), line(before, after), line(after, after2)])
        middle = np.nanmedian(np.where(np.isfinite(said), said, np.nan), axis=0)
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


def timing_jitter(times: Array, places: Array, valid: NDArray[np.bool_]) -> float:
    """Jitter in s, from how much more places scatter about a smooth track where an object is fast.

    Third divided differences of four frames along the way lose what is quadratic in the times that frames
    say they were taken at; over the root of their squared weights they have the variance of a frame. It is
    regressed on the squared speed; 0 where the slope is not above its standard error by `SHOWN_BY`.

    Args:
        times: (n, frames) s.
        places: (n, frames, 2) m.
        valid: (n, frames).
    """
    usual = float(np.median(np.diff(times, axis=1)[valid[:, 1:]]))
    four = np.stack([times[:, k : times.shape[1] - 3 + k] for k in range(4)], axis=-1)
    apart = four[..., :, None] - four[..., None, :] + np.eye(4)
    good = valid[:, 3:] & (four[..., 3] - four[..., 0] < 3 * SPAN * usual)
    good &= (np.abs(apart) > 0.1 * usual).all((-1, -2))
    weights = 1 / np.prod(np.where(good[..., None, None], apart, 1.0), axis=-1)
    weights /= np.linalg.norm(weights, axis=-1, keepdims=True)
    third = sum(weights[..., k, None] * places[:, k : places.shape[1] - 3 + k] for k in range(4))
    speed = frame_speeds(times, places, valid)[:, 1:-2]
    way = places[:, 3:] - places[:, :-3]
    way /= np.linalg.norm(way, axis=-1, keepdims=True) + 1e-9
    squares, by_speed = ((np.asarray(third) * way).sum(-1) ** 2)[good], speed[good] ** 2
    if len(squares) < MANY:
        return 0.0
    design = np.column_stack([np.ones_like(by_speed), by_speed])
    found = np.array([np.median(squares) * 1.4826**2, 0.0])
    for _ in range(10):
        expected = np.maximum(design @ found, 0.1 * found[0])
        kept = squares < CORE**2 * expected  # mistracks are left out
        weighted = design[kept] / expected[kept, None] ** 2
        information = weighted.T @ design[kept]
        found = np.linalg.solve(information, weighted.T @ squares[kept])
        found = np.array([max(found[0], 0.01 * float(squares.mean())), max(found[1], 0.0)])
    error = float(np.sqrt(2 * OVERLAP * np.linalg.inv(information)[1, 1]))
    return float(np.sqrt(found[1])) if found[1] > SHOWN_BY * error else 0.0
