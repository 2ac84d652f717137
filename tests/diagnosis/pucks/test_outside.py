"""Effects made apart from the catalogue and from the lab: no verdict may say what held-out hits deny."""

import numpy as np
import pytest
from slapshot.calibration.slide_recordings import CAMERA, RADIUS
from slapshot.diagnosis.pucks.diagnose import diagnose
from slapshot.diagnosis.pucks.headline import predicted_to_the_floor
from slapshot.diagnosis.pucks.result import Setting

from .outside import GRAVITY, World, hits


def dent(x, y, vx, vy, t):
    """A hollow 4 mm deep."""
    away = np.stack([1.1 - x, -0.05 - y], axis=-1)
    return GRAVITY * 0.004 / 0.12**2 * away * np.exp(-(away**2).sum(-1, keepdims=True) / (2 * 0.12**2))


def jet(x, y, vx, vy, t):
    """Of air, across the board, in a strip."""
    return np.stack([np.zeros_like(x), 0.5 * np.exp(-(((x - 1.1) / 0.1) ** 2))], axis=-1)


WORLDS = {
    "nothing": World(),
    "slug": World(offset=(-0.012, 0.0), inertia=0.6),
    "dent": World(push=dent),
    "contact time": World(friction=lambda x, y, t, order: 1 + 0.5 * t),
    "tide": World(friction=lambda x, y, t, order: np.exp(0.15 * np.sin(4 * np.pi * order))),
    "rolling shutter": World(stamp=lambda places: 0.05 * (places[..., 1] - 0.5)),
    "air jet": World(push=jet),
    "pushed": World(pushed=0.15),
}
# Of which pushes are none of the slide, and are left out or seen from their end on.
NOTHING = {"nothing", "pushed"}


@pytest.fixture(scope="module")
def diagnosed():
    setting = Setting(RADIUS, CAMERA, (0.4, 0.4, 0.008))
    return {name: diagnose(hits(world, 11), setting, 0).verdict for name, world in WORLDS.items()}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(WORLDS))
def test_a_verdict_is_honest_about_what_no_catalogue_holds(diagnosed, name):
    verdict = diagnosed[name]
    assert verdict.fit is not None
    if verdict.headline == "nothing_found":
        assert predicted_to_the_floor(verdict.fit["refitted"])
    if verdict.effects:
        before, after = verdict.fit["refitted"], verdict.fit["augmented"]
        assert after.rest_rmse_m.value <= before.rest_rmse_m.high
        assert after.track_rmse_m.value <= before.track_rmse_m.high
        assert after.loglik_per_hit.high >= 0
    if name in NOTHING:
        assert verdict.headline == "nothing_found"
    else:
        assert verdict.headline in ("found", "found_not_named")
