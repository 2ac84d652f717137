"""How well a fitted scene predicts hits that it has not seen: the slide, given its first frames.

The launch of a held-out hit is told from its first frames alone, under each scene's own physics, and the
rest of the track is predicted from it. The likelihood takes all frames, with the launch integrated out.
Where commands are known, rest points are predicted from them as well, before anything is seen of the hit.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.gauss_newton import Fit
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter
from slapshot.diagnosis.pucks.fit.told import told_launches
from slapshot.diagnosis.pucks.launch.launch_model import LaunchModel
from slapshot.diagnosis.pucks.slide.slide_model import Point
from slapshot.diagnosis.pucks.slide.tracks import RESTED_S, HitTracks
from slapshot.diagnosis.pucks.verdict import Errors, Interval

HELD_OUT = 0.25  # share of commands
FEWEST_COMMANDS = 8  # of which whole ones are held out; of fewer, hits
FEWEST_HITS = 3  # of each object, that are not held out
SEEN_SHARE = 0.35  # of a hit's frames, from which its launch is told
RESAMPLES = 1000
LIKELY, SURE = 0.9, 0.99  # probability of an interval, and of one that a headline rests on


@dataclass(frozen=True)
class HeldOut:
    """Of n held-out hits; what is expected is what noise and what nobody can know make of the best scene.

    Attributes:
        track_square, expected_track: (n,) m^2, mean over predicted frames of the squared distance.
        rest_square, expected_rest: (n,) m^2, of the last frame.
        command_square, expected_command: (n,) m^2, of the last frame predicted from the command; None
            where commands are not known.
        loglik, expected_loglik: (n,) nats, constants left out that are equal for all scenes.
        chi2: (n,) whitened squares of what the camera saw over their number, of which 1 is expected.
        encoder_chi2: (n,) the same of encoders, which are several times as many; None without any.
    """

    track_square: Array
    expected_track: Array
    rest_square: Array
    expected_rest: Array
    command_square: Array | None
    expected_command: Array | None
    loglik: Array
    expected_loglik: Array
    chi2: Array
    encoder_chi2: Array | None = None


def split_hits(tracks: HitTracks, rng: np.random.Generator) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows to use and to hold out; repeats of one of many commands are on one side.

    Of each object enough hits are used that its friction is known.
    """
    groups = tracks.command
    if len(np.unique(groups)) < FEWEST_COMMANDS:
        groups = np.arange(len(tracks))
    shuffled = rng.permutation(np.unique(groups))
    wanted, mask = max(2, round(HELD_OUT * len(shuffled))), np.zeros(len(tracks), bool)
    hits = np.bincount(tracks.object)
    spare = hits - np.minimum(hits, np.maximum(FEWEST_HITS, -(-hits // 2)))
    held = 0
    for command in shuffled:
        own = groups == command
        taken = np.bincount(tracks.object[own], minlength=len(hits))
        if held < wanted and np.all(taken <= spare):
            mask |= own
            spare, held = spare - taken, held + 1
    if held < 2:
        mask = np.isin(groups, shuffled[:wanted])
    return np.flatnonzero(~mask), np.flatnonzero(mask)


def predict_held_out(fitter: HitFitter, fit: Fit) -> HeldOut:
    """Errors of a fit of other hits on those of `fitter`."""
    valid = fitter.valid
    shown = first_frames(valid)
    point, covariance, _ = told_launches(fitter, fit, shown)
    predicted, by_latent = fitter.model.by_latents(point)
    ahead = valid & ~shown
    square = ((fitter.model.tracks.places - predicted) ** 2).sum(-1)
    spread = np.einsum("nfdu,nuv,nfdv->nf", by_latent, covariance, by_latent) + 2 * fitter.frame_sd**2
    rows, last = np.arange(len(valid)), valid.sum(1) - 1
    number = np.maximum(ahead.sum(1), 1)
    told, _, marginal = told_launches(fitter, fit)
    read, readings = fitter.launches.encoder_rows([], told), fitter.launches.rows
    by_encoders = None if read is None else (read[0] ** 2).sum(1)
    from_command: tuple[Array, Array] | tuple[None, None] = (None, None)
    if isinstance(fitter.launches, LaunchModel):
        from_command = _from_command(fitter, fit, fitter.launches)
    return HeldOut(
        track_square=(square * ahead).sum(1) / number,
        expected_track=(spread * ahead).sum(1) / number,
        rest_square=square[rows, last],
        expected_rest=spread[rows, last],
        command_square=from_command[0],
        expected_command=from_command[1],
        loglik=-(marginal.squares + marginal.log_volume) / 2,
        expected_loglik=-(fitter.freedom() + marginal.log_volume) / 2,
        chi2=(marginal.squares - (0.0 if by_encoders is None else by_encoders))
        / (fitter.freedom() - readings),
        encoder_chi2=None if by_encoders is None else by_encoders / readings,
    )


def first_frames(valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n, frames) those from which a launch is told."""
    shown = np.maximum(6, np.ceil(SEEN_SHARE * valid.sum(1)))[:, None]
    return valid & (np.arange(valid.shape[1]) < shown)


def _from_command(fitter: HitFitter, fit: Fit, launches: LaunchModel) -> tuple[Array, Array]:
    """(n,) m^2 of the last frame, and what the scatter of launches, of friction and frames make of it."""
    mean, covariance = launches.predicted(fit.point, fit.scatter.launch)
    latents = np.column_stack([mean, np.zeros(len(mean))])
    spread = np.zeros((len(mean), 6, 6))
    spread[:, :5, :5], spread[:, 5, 5] = covariance, fit.scatter.friction**2
    tracks, last = fitter.model.tracks, fitter.valid.sum(1) - 1
    seen = tracks.places[np.arange(len(last)), last]
    # Long after every hit has come to rest, also those that should have gone farther.
    rested = replace(
        tracks,
        times=np.full((len(last), 1), RESTED_S),
        places=seen[:, None],
        valid=np.ones((len(last), 1), bool),
    )
    slides = fitter.model.of(rested)
    predicted, by_latent = slides.by_latents(Point(latents, fit.point.nuisance, fit.point.effects))
    square = ((seen - predicted[:, 0]) ** 2).sum(-1)
    expected = np.einsum("ndu,nuv,ndv->n", by_latent[:, 0], spread, by_latent[:, 0])
    return square, expected + 2 * fitter.noise.sd**2


def errors_of(held: HeldOut, reference: Array, rng: np.random.Generator, unsure: float = 0.0) -> Errors:
    """With 90 % bootstrap intervals over hits; likelihood over `reference` (n,).

    Chi-squared counts in variances of the noise, whose relative standard error `unsure` widens its interval.
    It is that of the camera or of the encoders, whichever says more clearly that something is missing: in
    their sum the many readings of encoders hide what slides lack.
    """
    command = held.command_square
    camera = _widened(mean(held.chi2, rng, SURE), unsure)
    encoders = None if held.encoder_chi2 is None else mean(held.encoder_chi2, rng, SURE)
    return Errors(
        root_mean(held.track_square, rng),
        root_mean(held.rest_square, rng),
        None if command is None else root_mean(command, rng),
        mean(held.loglik - reference, rng),
        camera if encoders is None else max(camera, encoders, key=lambda interval: interval.low),
        camera,
        encoders,
    )


def _widened(chi2: Interval, unsure: float) -> Interval:
    """By a relative standard error of its unit."""
    far = chi2.value * unsure * float(ndtri((1 + SURE) / 2))
    low, high = np.hypot(chi2.value - chi2.low, far), np.hypot(chi2.high - chi2.value, far)
    return Interval(chi2.value, float(chi2.value - low), float(chi2.value + high))


def noise_floor(held: HeldOut, reference: Array, rng: np.random.Generator) -> Errors:
    """What the best scene could reach: camera noise, a launch told from few frames, scatter of launches.

    From commands it is told linearly about the mean launch. Where the slide is not linear in launches, as
    with an effect of unseen spin, that can exceed the errors themselves: then no floor is known.
    """
    command = held.expected_command
    floor = None if command is None else root_mean(command, rng)
    if floor is not None and held.command_square is not None:
        seen = root_mean(held.command_square, rng)
        floor = None if floor.low > seen.high else floor
    return Errors(
        root_mean(held.expected_track, rng),
        root_mean(held.expected_rest, rng),
        floor,
        mean(held.expected_loglik - reference, rng),
        Interval(1.0, 1.0, 1.0),
        None,
        None,
    )


def errors_of_scenes(
    test: HitFitter,
    about: HitFitter,
    nominal: Fit,
    final: Fit,
    friction: tuple[float, float, float],
    rng: np.random.Generator,
) -> dict[str, Errors]:
    """Of the nominal scene as believed and refitted, of the final one, and what noise leaves of that.

    Args:
        test: fitter of the held-out hits, linear about the nominal scene.
        about: the same about the final one.
        nominal: fit of other hits without effects.
        final: fit of them with those that were found.
        friction: of the nominal scene, as believed.
        rng: of bootstraps.
    """
    mu = np.tile(np.log(friction), (len(nominal.point.nuisance), 1))
    believed = replace(nominal, point=Point(nominal.point.latents, mu))
    refitted = predict_held_out(test, nominal)
    augmented = refitted if final is nominal else predict_held_out(about, final)
    scenes = {"nominal": predict_held_out(test, believed), "refitted": refitted, "augmented": augmented}
    found = {name: errors_of(held, refitted.loglik, rng, test.noise.error) for name, held in scenes.items()}
    return found | {"noise_floor": noise_floor(augmented, refitted.loglik, rng)}


def mean(values: Array, rng: np.random.Generator, probability: float = LIKELY) -> Interval:
    """With a bootstrap interval over hits."""
    draws = values[rng.integers(0, len(values), (RESAMPLES, len(values)))].mean(1)
    low, high = np.quantile(draws, [(1 - probability) / 2, (1 + probability) / 2])
    return Interval(float(values.mean()), float(low), float(high))


def root_mean(squares: Array, rng: np.random.Generator) -> Interval:
    """Root of the mean, with a 90 % bootstrap interval over hits."""
    square = mean(squares, rng)
    return Interval(*(float(np.sqrt(v)) for v in (square.value, square.low, square.high)))
