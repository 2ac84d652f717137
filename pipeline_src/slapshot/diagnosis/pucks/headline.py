"""The headline of a verdict: what the whole of a diagnosis comes to, decided on held-out hits.

- `cannot_tell`: the recording does not suffice, its fits cannot be trusted, or tests contradict each other;
- `found`: something is missing, and what is named predicts held-out hits no worse;
- `found_not_named`: something is missing (a test says so, or held-out hits are predicted worse than noise
  alone would), and no name holds;
- `nothing_found`: no test says so, and held-out hits are predicted to the noise floor.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slapshot.diagnosis.pucks.fit.hit_fit import FRICTION_SD, Scatter
from slapshot.diagnosis.pucks.selection.level import LEAST_SHIFT, P_VALUE, Level
from slapshot.diagnosis.pucks.verdict import Errors, Headline, Mismatch

MOST_BLAMED = 10  # hits that a reason names
FAR = 3.0  # robust sd of the logarithm of a hit's misfit, beyond which a hit stands out


@dataclass(frozen=True)
class Distrust:
    """Why fits cannot be trusted.

    Attributes:
        reason: with what to record or to mend, for a person.
        hits: numbers of those that are to blame, worst first; empty where none stands out.
    """

    reason: str
    hits: tuple[int, ...]


def undecided(level: Level, hits: NDArray[np.int64], pushed: Sequence[int]) -> Distrust | None:
    """Why a recording that no test calls mismatched cannot be called matched either; None if it can.

    Under the nominal scene a Bayes factor exceeds k with a probability of at most 1/k (Markov's inequality).
    Evidence beyond that, for an effect that would matter, which the spread from hit to hit does not
    confirm, is carried by a few hits.

    Args:
        level: as for `distrust`, as are the others.
        hits: (n,) numbers of the hits that were fitted.
        pushed: numbers of hits that are no clean slides.
    """
    mismatch = level.mismatch
    most = np.log(len(level.screen.log_evidence) / P_VALUE)
    if mismatch.found or mismatch.log_evidence <= most or mismatch.shift_m < LEAST_SHIFT:
        return None
    blamed = _blamed(level.nominal.fit, level, hits, pushed)
    return Distrust(
        f"the best description of what is left gains {mismatch.log_evidence:.0f} nats, which is no chance, "
        f"but the spread from hit to hit does not confirm it (p = {mismatch.p_value:.2g}): a few hits carry "
        f"it; record more hits, with repeats, and {_remedy(blamed)}",
        blamed,
    )


def headline_of(found: bool, named: bool, errors: Mapping[str, Errors]) -> Headline:
    """The headline of fits that can be trusted.

    Args:
        found: whether a test says that something is missing.
        named: whether a name for it holds.
        errors: of the scenes on held-out hits.
    """
    if found or not predicted_to_the_floor(errors["refitted"]):
        return "found" if named else "found_not_named"
    return "nothing_found"


def predicted_to_the_floor(errors: Errors) -> bool:
    """Whether the chi-squared a degree of freedom of held-out hits is not above 1 by more than chance."""
    return errors.chi2_per_freedom.low <= 1.0


def names_hold(errors: Mapping[str, Errors]) -> bool:
    """Whether what was named makes no measure of held-out hits worse than its interval without it."""
    before, after = errors["refitted"], errors["augmented"]
    pairs = (
        (before.track_rmse_m, after.track_rmse_m),
        (before.rest_rmse_m, after.rest_rmse_m),
        (before.command_rest_rmse_m, after.command_rest_rmse_m),
    )
    worse = any(b is not None and a is not None and a.value > b.high for b, a in pairs)
    return not worse and after.loglik_per_hit.high >= 0


def explained(errors: Mapping[str, Errors], most: float) -> bool:
    """Whether names leave no more of held-out hits' misfit than laws that err by a share `most` would.

    Chi-squared is a square: of what a law that errs by a share explains, it leaves the square of that share.
    What cameras and encoders see counts apart: a law that explains one of them explains nothing of the other.
    """
    before, after = errors["refitted"], errors["augmented"]
    pairs = ((before.camera_chi2, after.camera_chi2), (before.encoder_chi2, after.encoder_chi2))
    return all(
        a.low <= 1 + most**2 * max(b.value - 1, 0) for b, a in pairs if b is not None and a is not None
    )


def settled(mismatch: Mismatch, headline: Headline) -> Mismatch:
    """The mismatch as the headline has it."""
    if headline == "nothing_found":
        return replace(mismatch, found=False, decided_by=None)
    return replace(mismatch, found=True, decided_by="tests" if mismatch.found else "held-out hits")


def distrust(level: Level, hits: NDArray[np.int64], pushed: Sequence[int]) -> Distrust | None:
    """Why the fit that a diagnosis came to cannot be trusted; None if it can.

    Where much is missing, the nominal scene may fit so badly that its fit goes to and fro.

    Args:
        level: of the hits, or of rest points alone.
        hits: (n,) numbers of the hits that were fitted.
        pushed: numbers of those that a check of the recording found to be no clean slides.
    """
    final = level.final.fit
    if not final.converged:
        what = "what was found" if level.final.effects else "the nominal scene"
        return Distrust(
            f"the fit of {what} did not converge, so that nothing that rests on it can be said; "
            f"{_remedy(blamed := _blamed(final, level, hits, pushed))}",
            blamed,
        )
    if isinstance(final.scatter, Scatter) and final.scatter.friction >= FRICTION_SD[1]:
        blamed = _blamed(final, level, hits, pushed)
        return Distrust(
            f"friction would have to differ from hit to hit by {100 * FRICTION_SD[1]:.0f} % or more, which "
            "hides whatever else there is; record repeats of one command, keep object and surface as they "
            f"are between hits, and {_remedy(blamed)}",
            blamed,
        )
    return None


def _remedy(blamed: Sequence[int]) -> str:
    if not blamed:
        return "record more hits that differ in heading and speed, each one push, seen from rest to rest"
    several = len(blamed) > 1
    return (
        f"look first at hit{'s' * several} {', '.join(map(str, blamed))}, which fit{'s' * (not several)} "
        f"worst where the fit stopped or {'were' if several else 'was'} no single push (the cause may lie "
        "elsewhere), and record hits of one push each, seen from rest to rest"
    )


def _blamed(fit: Any, level: Level, hits: NDArray[np.int64], pushed: Sequence[int]) -> tuple[int, ...]:
    """Hits that fit far worse than most, worst first, then those that a check found."""
    misfit = np.log(np.maximum(fit.marginal.squares / level.search.fitter.freedom(), 1e-12))
    spread = 1.4826 * float(np.median(np.abs(misfit - np.median(misfit))))
    far = misfit > np.median(misfit) + FAR * spread
    worst = [int(hits[i]) for i in np.argsort(-misfit, kind="stable") if far[i]]
    return tuple(dict.fromkeys([*worst, *pushed]))[:MOST_BLAMED]
