"""Launches of a recording under effects far from the nominal scene: simulated there, and linear about it."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from slapshot.diagnosis.pucks.gauss_newton import Fit
from slapshot.diagnosis.pucks.launch_fit import LaunchFitter, launch_fitter
from slapshot.diagnosis.pucks.rig_model import RigModel
from slapshot.diagnosis.pucks.slide_fit import SlideFitter
from slapshot.effects.effect import Effect


def launches_about(
    slides: SlideFitter,
    fit: Fit,
    rig: RigModel,
    rows: NDArray[np.int64],
    nominal: LaunchFitter,
    first_s: float,
    effects: Mapping[str, Effect],
) -> Callable[[Fit], LaunchFitter]:
    """Fitters of the same launches with hits simulated under the effects of a fit."""

    def about(found: Fit) -> LaunchFitter:
        model = rig.about({**fit.point.effects, **found.point.effects}).launches(
            rows, nominal.launches.execution
        )
        return launch_fitter(
            slides, fit, model.given(fit.point.effects, fit.point.nuisance), effects, first_s
        )

    return about


class LaunchEvidence:
    """Log evidence in the launches for a fit of the slides, over that for the nominal fit.

    Slides and launches are two halves of one likelihood: an effect that moves what the camera sees, or where
    an object's mass is, must be right about both.
    """

    def __init__(
        self,
        slides: SlideFitter,
        nominal: Fit,
        rig: RigModel,
        rows: NDArray[np.int64],
        effects: Mapping[str, Effect],
    ) -> None:
        self._slides, self._rig, self._rows, self._effects = slides, rig, rows, effects
        self._model = rig.launches(rows)
        self._nominal = self._log_likelihood(nominal)

    def __call__(self, fit: Fit) -> float:
        """In nats; none for effects that begin with the slide."""
        acting = [self._effects[name] for name in fit.point.effects]
        if not any(effect.acts_on_launch or effect.acts_on_camera for effect in acting):
            return 0.0
        return self._log_likelihood(fit) - self._nominal

    def _log_likelihood(self, fit: Fit) -> float:
        effects = fit.point.effects
        model = self._rig.about(effects).launches(self._rows, self._model.execution)
        fitter = launch_fitter(self._slides, fit, model.given(effects, fit.point.nuisance), self._effects)
        return -fitter.fit(fitter.start()).objective / 2
