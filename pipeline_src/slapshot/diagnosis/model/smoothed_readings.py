"""Recorded readings, smoothed: the motion without the noise of its sensors."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from slapshot.arrays import Array
from slapshot.diagnosis.model.segments import Segments

_WINDOW_S = 0.06  # longer than the noise of an encoder, shorter than the motion of a robot


def smoothed(segments: Segments, own: NDArray[np.intp], columns: list[int]) -> tuple[Array, Array]:
    """Smoothed observations of consecutive segments and their rate, (nodes, columns); empty if none."""
    inside, h = segments.inside[own], segments.interval
    value = segments.y[own][:, :, columns][inside]
    late = segments.shift[own][:, :, columns[0]][inside] / h
    there = np.isfinite(value).all(axis=1)
    if there.sum() < 2:
        return np.zeros((0, len(columns))), np.zeros((0, len(columns)))
    known = value[there]
    if len(columns) == 4:
        # Of the two signs of a quaternion the one that is nearer to the one before.
        turns = np.sum(known[1:] * known[:-1], axis=1) < 0
        known[1:] *= np.cumprod(np.where(turns, -1.0, 1.0))[:, None]
    nodes = np.arange(len(value))
    value = np.stack([np.interp(nodes, (nodes + late)[there], part) for part in known.T], axis=1)
    window = min(max(5, round(_WINDOW_S / h) | 1), (len(value) - 1) | 1)
    if window < 5:
        return value, np.gradient(value, h, axis=0)
    smooth = savgol_filter(value, window, 3, axis=0)
    return smooth, savgol_filter(value, window, 3, 1, h, axis=0)


def assign(x: Array, run: NDArray[np.intp], inside: NDArray[np.bool_], column: int, values: Array) -> None:
    """Put values into a column of some segments (S, L, columns), where nodes are inside."""
    part = x[run, :, column]
    part[inside] = values
    x[run, :, column] = part
