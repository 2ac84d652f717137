"""Tracks of hits as the nominal and the augmented scene predict them from their first frames."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.gauss_newton import Fit
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter
from slapshot.diagnosis.pucks.fit.told import told_launches
from slapshot.diagnosis.pucks.held_out import first_frames


@dataclass(frozen=True)
class Predicted:
    """n hits; frames in arrays padded to the longest hit.

    Attributes:
        hit: (n,) number of the hit.
        times: (n, frames) s since the release.
        recorded: (n, frames, 2) m.
        nominal: (n, frames, 2) m, of the nominal scene with friction refitted.
        augmented: (n, frames, 2) m, of the scene with what was found; None where nothing was.
        valid: (n, frames) which of them are frames.
        shown: (n, frames) those from which the launch was told.
    """

    hit: NDArray[np.int64]
    times: Array
    recorded: Array
    nominal: Array
    augmented: Array | None
    valid: NDArray[np.bool_]
    shown: NDArray[np.bool_]

    @property
    def ahead(self) -> NDArray[np.bool_]:
        """(n, frames) those that were predicted."""
        return self.valid & ~self.shown

    @property
    def last(self) -> NDArray[np.int64]:
        """(n,) the last frame of each hit."""
        return self.valid.sum(1) - 1

    def rmse(self, places: Array) -> Array:
        """(n,) m, of predicted frames."""
        square = ((places - self.recorded) ** 2).sum(-1) * self.ahead
        return np.sqrt(square.sum(1) / np.maximum(self.ahead.sum(1), 1))

    def rest_error(self, places: Array) -> Array:
        """(n,) m, of the last frame."""
        rows = np.arange(len(self.hit))
        return np.linalg.norm((places - self.recorded)[rows, self.last], axis=1)


def predict(fitter: HitFitter, nominal: Fit, augmented: Fit | None) -> Predicted:
    """Predictions of the hits of a fitter by two fits, the second where effects were found."""
    tracks, valid = fitter.model.tracks, fitter.valid
    shown = first_frames(valid)
    return Predicted(
        hit=tracks.hit,
        times=tracks.times,
        recorded=tracks.places,
        nominal=_from_first_frames(fitter, nominal, shown),
        augmented=None if augmented is None else _from_first_frames(fitter, augmented, shown),
        valid=valid,
        shown=shown,
    )


def _from_first_frames(fitter: HitFitter, fit: Fit, shown: NDArray[np.bool_]) -> Array:
    """(n, frames, 2) m: the launch is told from the frames shown, the shared parameters are held."""
    point, _, _ = told_launches(fitter, fit, shown)
    return fitter.model.predict(point)
