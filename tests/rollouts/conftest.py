import numpy as np
import pytest
from slapshot.rollouts.contact import Hits
from slapshot.scenes.randomisation import draw_conditions, draw_start_errors


@pytest.fixture(scope="session")
def make_hits(rig, hockey_config):
    """count, seed -> hits of random swings under random conditions."""

    def make(count: int, seed: int = 0) -> Hits:
        rng = np.random.default_rng(seed)
        randomisation = hockey_config["randomisation"]
        return Hits(
            swings=rng.integers(0, len(rig.swings.latents), count),
            conditions=draw_conditions(randomisation, count, rng),
            start_errors=draw_start_errors(randomisation, count, rng),
        )

    return make
