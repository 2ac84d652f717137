"""On-policy hits in simulation, for commands that no pool of swings holds."""

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
    """Hits under randomised conditions, as the rollouts' but for swings, which follow commands exactly."""

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
            scene: to hit in.
            domain: of the scene, whose part `collector` simulates.
            model: of trajectories.
            conditions: (c) rows of CONDITION_PARAMETERS.
            start_error: of the rollouts.
            cores: to use.
        """
        self._scene, self._model, self._cores = scene, model, cores
        self._collector = load_part(domain, "collector").Collector
        self._conditions = conditions
        self._start_error = start_error

    def rests(self, conditions: NDArray[np.int64], latents: Array, rng: np.random.Generator) -> Array:
        """(n, 2) m, of latents (n, latent) under rows (n,) of the conditions.

        Latents farther out than trajectory models are trained for are moved to where that ends.
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
