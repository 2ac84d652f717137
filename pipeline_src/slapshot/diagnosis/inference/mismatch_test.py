"""Score statistics of candidate columns, after elimination of the nuisance; mismatch test and screening.

With whitened residuals e and columns Z = [candidates | nuisance] of each segment, inference needs only
b = Zᵀe and H = ZᵀZ, segment by segment.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import Innovations

_FEWEST = 0.01  # minimum degrees of freedom between segments
_ROUND = 1e-8  # relative jitter for duplicate columns
_CHANCE = 0.05  # that blocks disagree as much by chance


@dataclass(frozen=True)
class Scores:
    """Scores of S segments.

    Attributes:
        b: (S, p) Zᵀe.
        H: (S, p, p) ZᵀZ.
        prior_sd: (p,) of the columns' values; infinite for none.
        nuisance: (p,) columns that are eliminated.
    """

    b: Array
    H: Array
    prior_sd: Array
    nuisance: NDArray[np.bool_]


def scores(found: Innovations, prior_sd: Array, nuisance: NDArray[np.bool_]) -> Scores:
    """Scores of innovations, in units of the priors."""
    S, p = found.e.shape[0], found.Z.shape[-1]
    z = found.Z.reshape(S, -1, p) * prior_sd
    e = found.e.reshape(S, -1)
    return Scores(np.einsum("snp,sn->sp", z, e), np.matmul(z.transpose(0, 2, 1), z), prior_sd, nuisance)


@dataclass(frozen=True)
class Eliminated:
    """Efficient scores of candidates, orthogonal to the nuisance.

    Attributes:
        segment: (S, k) each segment's; their sum is that of generalised least squares.
        information: (k, k) of all.
        by_segment: information of each segment on some candidates, (S, g, g); None where it is equal.
        shared: (k, k) part of the information that stems from the residual nuisance, shared by all segments;
            None for none.
    """

    segment: Array
    information: Array
    by_segment: Callable[[NDArray[np.intp]], Array] | None = None
    shared: Array | None = None

    @property
    def total(self) -> Array:
        """(k,) sum over segments."""
        return np.asarray(self.segment.sum(0))


class Elimination:
    """Elimination of the nuisance, for the data and for draws alike.

    Args:
        of: scores in units of the priors, so that the prior of the nuisance is N(0, I).
    """

    def __init__(self, of: Scores) -> None:
        self._candidate, self._nuisance = np.flatnonzero(~of.nuisance), np.flatnonzero(of.nuisance)
        c, m = self._candidate, self._nuisance
        self._H = of.H
        total = of.H.sum(0)
        self._prior = np.eye(len(m)) + total[np.ix_(m, m)]
        # Share of each nuisance column in each candidate.
        self._share = np.linalg.solve(self._prior, total[np.ix_(m, c)])
        # Each segment's H of all columns with the nuisance; of that itself with its part of the prior.
        self._of_nuisance = np.ascontiguousarray(of.H[:, :, m])
        among = self._of_nuisance[:, m]
        self._cross = self._of_nuisance[:, c] - self._share.T @ among
        self._of_share = (among + np.eye(len(m)) / len(of.H)) @ self._share
        self.information = total[np.ix_(c, c)] - total[np.ix_(c, m)] @ self._share
        self._shared = self._share.T @ self._share
        self._found: dict[bytes, Array] = {}

    def __call__(self, b: Array) -> Eliminated:
        """Efficient scores.

        Args:
            b: (..., S, p) scores.
        """
        c, m = self._candidate, self._nuisance
        values = np.linalg.solve(self._prior, b[..., m].sum(-2)[..., None])[..., 0]
        raw = b[..., c] - b[..., m] @ self._share
        # The prior of the nuisance acts as further data that all segments share.
        prior = (values @ self._share / b.shape[-2])[..., None, :]
        S, k, n = self._cross.shape
        known = (values @ self._cross.reshape(S * k, n).T).reshape(*values.shape[:-1], S, k)
        return Eliminated(raw - known + prior, self.information, self.by_segment, self._shared)

    def by_segment(self, group: NDArray[np.intp]) -> Array:
        """Each segment's information of some candidates, (S, g, g); the sum is that of all.

        Cached, since the data and every draw need the same.
        """
        if group.tobytes() not in self._found:
            self._found[group.tobytes()] = self._by_segment(group)
        return self._found[group.tobytes()]

    def _by_segment(self, group: NDArray[np.intp]) -> Array:
        columns, share = self._candidate[group], self._share[:, group]
        own = self._H[:, columns[:, None], columns[None, :]]
        cross = self._of_nuisance[:, columns] @ share
        return own - cross - cross.transpose(0, 2, 1) + share.T @ self._of_share[:, :, group]


class Draws:
    """Draws of scores under the null hypothesis: only noise and nuisance.

    Args:
        of: scores in units of the priors.
        rng: for draws.
    """

    def __init__(self, of: Scores, rng: np.random.Generator) -> None:
        self._H, self._nuisance, self._rng = of.H, np.flatnonzero(of.nuisance), rng
        size = np.sqrt(np.maximum(np.einsum("spp->sp", of.H), 1e-300))
        alike = of.H / (size[:, :, None] * size[:, None, :]) + _ROUND * np.eye(of.H.shape[-1])
        self._roots = size[:, :, None] * _root(alike)

    def __call__(self, count: int) -> Array:
        """Further draws, (count, S, p)."""
        S, p = self._H.shape[:2]
        values = np.zeros((count, p))
        values[:, self._nuisance] = self._rng.standard_normal((count, len(self._nuisance)))
        noise = np.matmul(self._rng.standard_normal((S, count, p)), self._roots.transpose(0, 2, 1))
        return (noise + np.matmul(values, self._H)).transpose(1, 0, 2)


def _root(covariance: Array) -> Array:
    """(S, p, p) R with R Rᵀ the covariances, whose smallest eigenvalues may be negative by rounding."""
    try:
        return np.asarray(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        eigenvalues, vectors = np.linalg.eigh(covariance)
        return np.asarray(vectors * np.sqrt(np.maximum(eigenvalues, 0.0))[:, None])


def group_statistics(found: Eliminated, groups: Sequence[NDArray[np.intp]], least: float = 0.0) -> Array:
    """Hotelling's test of each group of columns on the segments' scores, as -log p; (..., groups).

    The sum of a group's scores is compared with their spread between segments, so that noise that is larger
    or more
    correlated than modelled affects both: for one column with equal information in all segments this is
        Student's
    t. The spread is assumed isotropic in units of the information. The nuisance contributes to the sum but
    not to the spread, as all segments share it; its contribution follows from the priors. A single segment is
    compared with the information alone. Groups without information have 0.

    Args:
        found: efficient scores, in units of the priors.
        groups: indices of each group among the candidates.
        least: information, in units of the priors, below which a direction is not tested: what would be seen
            there is beyond belief.
    """
    statistic = []
    segments = found.segment.shape[-2]
    for group in groups:
        information = found.information[np.ix_(group, group)]
        eigenvalues, vectors = np.linalg.eigh(information)
        keep = eigenvalues > max(1e-8 * eigenvalues.max(), 1e-308, least)
        white = vectors[:, keep] / np.sqrt(eigenvalues[keep])
        k = white.shape[1]
        nuisance = np.zeros(k)
        if found.shared is not None and k:
            nuisance, axes = np.linalg.eigh(white.T @ found.shared[np.ix_(group, group)] @ white)
            nuisance, white = np.clip(nuisance, 0.0, 1.0), white @ axes
        each = found.segment[..., group] @ white
        sums = each.sum(-2)
        if k == 0:
            statistic.append(np.zeros(sums.shape[:-1]))
        elif segments == 1:
            statistic.append(-chi2.logsf((sums**2).sum(-1), k))
        else:
            share = np.broadcast_to(np.eye(k) / segments, (segments, k, k))
            if found.by_segment is not None:
                share = white.T @ found.by_segment(group) @ white
            # A single dominant segment contributes to sum and spread alike and is not significant by itself.
            alike = float(np.sum(share**2)) / k
            about = ((each - np.einsum("sij,...j->...si", share, sums)) ** 2).sum((-2, -1))
            free = max(1 / alike - 1, _FEWEST)
            noise = about * (1 + 1 / free) / max(float(np.sum(1 - nuisance)), 1e-12)
            variance = np.maximum(noise[..., None], 1e-12) * (1 - nuisance) + nuisance
            statistic.append(-f_distribution.logsf((sums**2 / variance).mean(-1), k, k * free))
    return np.stack(statistic, axis=-1)


def overdispersion(of: Scores, block: NDArray[np.intp]) -> float:
    """Variance of the candidates' scores between segments, relative to the noise; at least 1.

    What is left out may last for longer than a segment, so that scores of neighbours agree: whole blocks are
    compared as well, as far as they differ by more than chance.

    Args:
        of: scores.
        block: (S,) block of each segment.
    """
    eliminated = Elimination(of)(of.b)
    every = np.arange(eliminated.information.shape[0])
    eigenvalues, vectors = np.linalg.eigh(eliminated.information)
    keep = eigenvalues > 1e-8 * max(eigenvalues.max(initial=0.0), 1e-300)
    white = vectors[:, keep] / np.sqrt(eigenvalues[keep])
    k = white.shape[1]
    if not k or eliminated.by_segment is None:
        return 1.0
    share = white.T @ eliminated.by_segment(every) @ white
    each = eliminated.segment @ white
    found = [1.0]
    for part, by_chance in ((np.arange(len(each)), False), (block, True)):
        within = np.arange(part.max() + 1)[:, None] == part
        own = np.einsum("bs,sij->bij", within, share)
        about = within @ each - np.einsum("bij,j->bi", own, each.sum(0))
        common = float(np.sum(own**2))  # which was fitted
        if k - common > _FEWEST:
            free = k * (k / common - 1)
            most = chi2.isf(_CHANCE, free) / free if by_chance else 1.0
            found.append(float(np.sum(about**2)) / (k - common) / most)
    return max(found)


DRAWS = 499


@dataclass(frozen=True)
class MismatchTest:
    """Outcome.

    Attributes:
        p_value: of the largest statistic of all groups; of a step's test (`selection/steps.py`) with that of
            pushes.
        statistics: (groups,) -log p of each group by itself.
        largest: index of the group with the largest.
        push_p_value: of the largest force in a short window; 1 if not tested.
    """

    p_value: float
    statistics: Array
    largest: int
    push_p_value: float = 1.0


def mismatch_test(
    of: Scores,
    groups: Sequence[NDArray[np.intp]],
    rng: np.random.Generator,
    count: int = DRAWS,
    least: float = 0.0,
) -> MismatchTest:
    """Test all groups of candidate columns at once.

    Args:
        of: scores in units of the priors.
        groups: indices of each group among the candidates.
        rng: for draws.
        count: of draws.
        least: information below which a direction is not tested, see `group_statistics`.
    """
    eliminate = Elimination(of)
    seen = group_statistics(eliminate(of.b), groups, least)
    draws = Draws(of, rng)
    largest = np.concatenate(
        [group_statistics(eliminate(draws(part)), groups, least).max(-1) for part in _parts(count, 100)]
    )
    exceeding = int(np.sum(largest >= seen.max()))
    return MismatchTest((1 + exceeding) / (count + 1), seen, int(np.argmax(seen)))


def _parts(count: int, size: int) -> list[int]:
    return [size] * (count // size) + ([count % size] if count % size else [])


@dataclass(frozen=True)
class Gain:
    """Gain of a group of columns.

    Attributes:
        log_evidence: nats, by Laplace's method; exact where columns are linear.
        values: (k,) in units of the priors.
    """

    log_evidence: float
    values: Array


def gains(eliminated: Eliminated, groups: Sequence[NDArray[np.intp]]) -> list[Gain]:
    """Gains of all groups, each by itself."""
    total, information = eliminated.total, eliminated.information
    found = []
    for group in groups:
        precision = np.eye(len(group)) + information[np.ix_(group, group)]
        values: Array = np.asarray(np.linalg.solve(precision, total[group]))
        volume = 0.5 * np.linalg.slogdet(precision)[1]
        found.append(Gain(float(0.5 * total[group] @ values - volume), values))
    return found
