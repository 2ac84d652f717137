"""Narrow ranges of randomisation about the parameters that a diagnosis fitted to a rig."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from slapshot.arrays import Array
from slapshot.config.randomisation import Draw, Draws

SDS = 2.0  # least half-width of a range, in standard deviations of the fitted value
_FRICTION = ("friction_x", "friction_y", "friction_torsional")


def refitted_ranges(randomisation: Draws, refit: Mapping[str, Any], margin: float) -> Draws:
    """The randomisation with ranges about the fitted parameters.

    A range covers the fits without and with the effects that were found, so that arms with and without them
    draw from the same range. Parameters that a diagnosis does not fit (rolling friction) keep their range.

    Args:
        randomisation: as in the configuration.
        refit: as written by `slapshot.diagnosis.pucks.refit`.
        margin: least margin of a range beyond the fitted values, as a share of them.
    """
    fits = [one[scene] for one in refit["objects"].values() for scene in ("nominal", "final")]
    log_mu = np.log([fit["friction"] for fit in fits])
    sd = np.array([fit["log_sd"] for fit in fits])
    found: dict[str, Draw] = {}
    for k, name in enumerate(_FRICTION):
        factor = randomisation.of_parameter(name).times
        value, spread = log_mu[:, k], sd[:, k]
        if factor is not None:
            other = _FRICTION.index(factor)
            value, spread = value - log_mu[:, other], np.hypot(spread, sd[:, other])
        found[name] = randomisation.of_parameter(name).within(*_about(value, spread, margin))
    mass = np.array([[one["mass_kg"], one["mass_sd_kg"]] for one in refit["objects"].values()])
    found["mass"] = randomisation.mass.within(*_about(np.log(mass[:, 0]), mass[:, 1] / mass[:, 0], margin))
    if refit["start_error_sd_m"] is not None:
        found["start_error"] = Draw(normal=[0.0, refit["start_error_sd_m"]])
    return Draws.from_parts(randomisation, **found)


def _about(logs: Array, sds: Array, margin: float) -> tuple[float, float]:
    """Range [low, high] around values with logarithms (n,) and standard deviations of those (n,)."""
    reach = np.maximum(np.log1p(margin), SDS * sds)
    return float(np.exp((logs - reach).min())), float(np.exp((logs + reach).max()))
