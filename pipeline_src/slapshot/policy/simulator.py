"""On-policy hits in simulation, for commands that are not in the pool of swings."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.config.randomisation import CONDITION_PARAMETERS, Draw
from slapshot.goal_reaching.expected_cost import LARGEST_LATENT
from slapshot.rollouts.hits import HitCollector, Hits
from slapshot.scenes.domain import load_part
from slapshot.scenes.randomisation import draw_start_errors
from slapshot.scenes.scene import Scene
from slapshot.trajectories.ideal import ideal_swings
from slapshot.trajectories.vae import TrajectoryVae


class Simulator:
    """Hits under randomised conditions, like those of the rollouts, but with perfectly tracked swings."""

    def __init__(
        self,
        scene: Scene,
        domain: str,
        model: TrajectoryVae,
        conditions: pd.DataFrame,
        start_error: Draw,
        cores: int,
    ) -> None:
        """Prepare.

        Args:
            scene: scene of the hits.
            domain: of the scene; its module `collector` simulates the hits.
            model: trajectory model.
            conditions: (c) rows of CONDITION_PARAMETERS.
            start_error: distribution of start position errors, as in the rollouts.
            cores: to use.
        """
        self._scene, self._model, self._cores = scene, model, cores
        self._collector = load_part(domain, "collector").Collector
        self._conditions = conditions
        self._start_error = start_error

    def rests(self, conditions: NDArray[np.int64], latents: Array, rng: np.random.Generator) -> Array:
        """Rest points (n, 2) in m of latents (n, latent) under rows (n,) of the conditions.

        Latent components are clipped to +-LARGEST_LATENT, the range that trajectory models are trained for.
        """
        swings = ideal_swings(self._scene, self._model, np.clip(latents, -LARGEST_LATENT, LARGEST_LATENT))
        collector: HitCollector = self._collector(self._scene, swings, self._cores)
        rows = self._conditions.iloc[conditions]
        hits = Hits(
            swings=np.arange(len(latents)),
            conditions={name: rows[name].to_numpy(float) for name in CONDITION_PARAMETERS},
            start_errors=draw_start_errors(self._start_error, len(latents), rng),
        )
        return collector.collect(hits).rests[:, :2]
