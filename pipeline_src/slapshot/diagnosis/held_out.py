"""How well a fitted scene predicts hits that it has not seen: the slide, given its first frames.

The launch of a held-out hit is told from its first frames alone, under each scene's own physics, and the
rest of the track is predicted from it. The likelihood takes all frames, with the launch integrated out.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slapshot.diagnosis.slide_fit import Fit, SlideFitter, bounded_step
from slapshot.diagnosis.slide_model import Point
from slapshot.diagnosis.verdict import Errors, Interval

Array = NDArray[np.float64]

SEEN_SHARE = 0.35  # of a hit's frames, from which its launch is told
RESAMPLES = 1000
STEPS = 6  # of Gauss-Newton for a launch
Z90 = 1.645


@dataclass(frozen=True)
class HeldOut:
    """Of n held-out hits.

    Attributes:
        track_square: (n,) m^2, mean over predicted frames of the squared distance.
        rest_square: (n,) m^2, of the last frame.
        loglik: (n,) nats, constants left out that are equal for all scenes.
        expected_square: (n,) m^2 that noise and the uncertain launch alone would make of track_square.
        expected_rest: (n,) m^2 likewise of rest_square.
        expected_loglik: (n,) of loglik.
    """

    track_square: Array
    rest_square: Array
    loglik: Array
    expected_square: Array
    expected_rest: Array
    expected_loglik: Array


def predict_held_out(fitter: SlideFitter, fit: Fit) -> HeldOut:
    """Errors of a fit of other hits on those of `fitter`."""
    valid = fitter.valid
    frames = np.arange(valid.shape[1])
    counts = valid.sum(1)
    shown = valid & (frames < np.maximum(6, np.ceil(SEEN_SHARE * counts))[:, None])
    point, covariance = _launches(fitter, fit, shown)
    predicted, by_latent = fitter.model.by_latents(point)
    ahead = valid & ~shown
    square = ((fitter.model.tracks.places - predicted) ** 2).sum(-1)
    spread = np.einsum("nfdu,nuv,nfdv->nf", by_latent, covariance, by_latent) + 2 * fitter.frame_sd**2
    last = counts - 1
    rows = np.arange(len(counts))
    rest_square, expected_rest = square[rows, last], spread[rows, last]
    number = np.maximum(ahead.sum(1), 1)

    full, _ = _launches(fitter, fit, valid)
    marginal = fitter.evaluate(full, [], fit.scatter)
    return HeldOut(
        track_square=(square * ahead).sum(1) / number,
        rest_square=rest_square,
        loglik=-(marginal.squares + marginal.log_volume) / 2,
        expected_square=(spread * ahead).sum(1) / number,
        expected_rest=expected_rest,
        expected_loglik=-(fitter.freedom() + marginal.log_volume) / 2,
    )


def _launches(fitter: SlideFitter, fit: Fit, shown: NDArray[np.bool_]) -> tuple[Point, Array]:
    """Latents from the frames shown, shared parameters held, and their covariance (n, 6, 6)."""
    start = fitter.start()
    point = Point(start.latents, fit.point.nuisance, fit.point.effects)
    covariance = np.empty(0)
    for _ in range(STEPS):
        marginal = fitter.evaluate(point, [], fit.scatter, shown)
        point = replace(point, latents=bounded_step(point.latents, marginal.step))
        covariance = marginal.covariance
    return point, covariance


def errors(held: HeldOut, reference: Array, rng: np.random.Generator) -> Errors:
    """With 90 % bootstrap intervals over hits; likelihood over `reference` (n,)."""
    return Errors(
        _root_mean(held.track_square, rng),
        _root_mean(held.rest_square, rng),
        _mean(held.loglik - reference, rng),
    )


def noise_floor(held: HeldOut, reference: Array, rng: np.random.Generator) -> Errors:
    """What the best scene could reach: camera noise and a launch told from a few frames."""
    return Errors(
        _root_mean(held.expected_square, rng),
        _root_mean(held.expected_rest, rng),
        _mean(held.expected_loglik - reference, rng),
    )


def _mean(values: Array, rng: np.random.Generator) -> Interval:
    draws = values[rng.integers(0, len(values), (RESAMPLES, len(values)))].mean(1)
    return Interval(float(values.mean()), float(np.quantile(draws, 0.05)), float(np.quantile(draws, 0.95)))


def _root_mean(squares: Array, rng: np.random.Generator) -> Interval:
    mean = _mean(squares, rng)
    return Interval(*(float(np.sqrt(v)) for v in (mean.value, mean.low, mean.high)))
