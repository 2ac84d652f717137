"""How objects were seen to turn: their spin at the release, which places alone hardly tell.

Only the beginning of a slide is used. How spin dies depends on how an object presses on the ground: of a
disc that presses evenly it dies half as fast as of one that stands on its rim.
"""

from dataclasses import dataclass

import numpy as np

from slapshot.arrays import Array

LEAST_SD = 2e-3  # rad; no camera sees more
LAW = 0.05  # share of a spin by which what is read off the first frames errs
ORIENTED, FEWEST = 3, 6  # fewest frames that tell an orientation, and a spin
SHARE = 0.35  # of a slide's frames, beyond those
JUMP = 0.5  # rad from the median of five frames: another marker was seen, or none


@dataclass(frozen=True)
class Turn:
    """What yaw says of a hit's release; NaN where it was not measured.

    Attributes:
        turned: rad from the orientation before the hit; NaN too where that was not seen.
        spin: rad/s.
        spin_error: rad/s over the noise of yaw in rad, standard error of the spin.
        noise: (m,) residuals in rad of yaw at rest.
    """

    turned: float
    spin: float
    spin_error: float
    noise: Array


def unwrapped(yaw: Array) -> Array:
    """(frames,) rad without jumps by whole turns; NaN where not measured, or far from its neighbours."""
    found = yaw.astype(float).copy()
    seen = np.flatnonzero(np.isfinite(found))
    if len(seen) < FEWEST:
        return np.full(len(yaw), np.nan)
    values = np.unwrap(found[seen])
    padded = np.pad(values, 2, mode="edge")
    middle = np.median(np.stack([padded[k : k + len(values)] for k in range(5)]), axis=0)
    found[seen] = np.where(np.abs(values - middle) < JUMP, values, np.nan)
    return found


def turn_of(times: Array, yaw: Array, begin: int, first: int, last: int) -> Turn:
    """Of the frames of a hit.

    Args:
        times: (frames,) s.
        yaw: (frames,) rad.
        begin: row at which motion begins.
        first: row at which the object is released.
        last: row from which on it rests.
    """
    yaw = unwrapped(yaw)
    lay, lies = (part[np.isfinite(part)] for part in (yaw[:begin], yaw[last:]))
    rests = [_about_mean(part) for part in (lay, lies) if len(part) >= FEWEST]
    noise = np.concatenate(rests or [lay[:0]])
    slide = slice(first, first + max(FEWEST, int(SHARE * (last - first))))
    seen = np.isfinite(yaw[slide])
    if seen.sum() < FEWEST:
        return Turn(np.nan, np.nan, np.nan, noise)
    since = times[slide][seen] - times[first]
    design = np.stack([np.ones_like(since), since, since**2 / 2], axis=1)
    inverse = np.linalg.pinv(design)
    start, spin, _ = inverse @ yaw[slide][seen]
    before = float(np.median(lay)) if len(lay) >= ORIENTED else np.nan
    return Turn(float(start) - before, float(spin), float(np.linalg.norm(inverse[1])), noise)


def _about_mean(values: Array) -> Array:
    """Residuals of the variance that the values have about the true mean."""
    return (values - values.mean()) * np.sqrt(len(values) / (len(values) - 1))


def spins_seen(turns: list[Turn]) -> tuple[Array, Array]:
    """(n,) rad/s spins at the release and their standard errors; those are infinite where nobody saw it."""
    spin, error = np.array([t.spin for t in turns]), np.array([t.spin_error for t in turns])
    noise = np.concatenate([t.noise for t in turns] or [spin[:0]])
    sd = max(1.4826 * float(np.median(np.abs(noise))), LEAST_SD) if len(noise) else np.inf
    error = np.hypot(error * sd, LAW * spin)
    seen = np.isfinite(error)
    return np.where(seen, spin, 0.0), np.where(seen, error, np.inf)
