"""Measures of the pipeline: speed and error of hits, memory, and training."""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from slapshot.adaptation.method import AdaptationMethod, Sizes, load_method
from slapshot.config.domain import Domain
from slapshot.config.methods import DomainTraining, MethodSettings, Training
from slapshot.config.randomisation import Draws
from slapshot.config.rollouts import RolloutsSettings
from slapshot.rollouts.__main__ import simulate
from slapshot.rollouts.hits import HitCollector, Hits
from slapshot.scenes.domain import load_part
from slapshot.scenes.randomisation import draw_conditions, draw_start_errors
from slapshot.scenes.scene import Scene
from slapshot.trajectories.swings import Swings
from slapshot.trajectories.vae import TrajectoryVae

HITS = 2048  # for the speed of the collector
ROUNDS = 3
SLOW_HITS = 96  # for measures that simulate the whole arm


class Measure(NamedTuple):
    """A row of benchmark.csv."""

    measure: str
    value: float
    unit: str


def draw_hits(randomisation: Draws, swings: Swings, count: int, seed: int, pool: str = "test") -> Hits:
    """Random swings of a split under random conditions."""
    rng = np.random.default_rng(seed)
    return Hits(
        swings=rng.choice(swings.of_split(pool), count),
        conditions=draw_conditions(randomisation, count, rng),
        start_errors=draw_start_errors(randomisation.start_error, count, rng),
    )


def hit_measures(
    domain: str, settings: Domain, scene: Scene, model: TrajectoryVae, swings: Swings
) -> list[Measure]:
    """Speed on one core against a plain loop over the same hits, and error against the reference.

    Args:
        domain: its name in the configuration.
        settings: the domain's block.
        scene: of the domain.
        model: of its trajectories.
        swings: of its pool.
    """
    randomisation, kind = settings.randomisation, settings.scene.domain
    reference, execute = load_part(kind, "reference"), load_part(kind, "execution").execute
    hits = draw_hits(randomisation, swings, HITS, seed=1)
    few = hits.rows(slice(0, SLOW_HITS))
    collector: HitCollector = load_part(kind, "collector").Collector(scene, swings, threads=1)
    collector.collect(few)  # compiles the slide
    # Interleaved, minimum of each: load from other processes then slows both alike.
    rounds = [
        (seconds(lambda: collector.collect(hits)), seconds(lambda: reference.plain_rests(scene, swings, few)))
        for _ in range(ROUNDS)
    ]
    collect_rate, slow_rate = HITS / min(r[0] for r in rounds), SLOW_HITS / min(r[1] for r in rounds)
    latents = swings.latents[np.unique(hits.swings)]
    swing_seconds = seconds(lambda: execute(scene, model, latents, np.zeros(len(latents), int), 1))
    # With swings: every hit needs a swing of its own, as for hits requested one by one.
    with_swings = 1 / (1 / collect_rate + swing_seconds / len(latents))
    fast = collector.collect(few).rests[:, :2]
    error = 1e3 * np.linalg.norm(fast - reference.exact_rests(scene, swings, few), axis=1)
    rows = [
        Measure(f"{domain}_hits_per_second_and_core", collect_rate, "1/s"),
        Measure(f"{domain}_hits_per_second_and_core_with_own_swing", with_swings, "1/s"),
        Measure(f"{domain}_hits_per_second_{reference.LOOP}", slow_rate, "1/s"),
        Measure(f"{domain}_hits_ratio_to_{reference.LOOP}", collect_rate / slow_rate, "1"),
        Measure(f"{domain}_hits_ratio_to_{reference.LOOP}_with_own_swing", with_swings / slow_rate, "1"),
        Measure(f"{domain}_rest_error_mm_median", float(np.median(error)), "mm"),
        Measure(f"{domain}_rest_error_mm_90_percent", float(np.quantile(error, 0.9)), "mm"),
    ]
    return rows


def memory_measures(domain: str, folders: Mapping[str, Path], settings: RolloutsSettings) -> list[Measure]:
    """Peak memory of a process that collects few hits and of one that collects eight times as many."""
    peaks = []
    for factor in (1, 8):
        code = (
            "import json, sys; from pathlib import Path\n"
            "from slapshot.benchmark.measures import peak_memory\n"
            "folders, settings, factor = json.loads(sys.argv[1])\n"
            "print(peak_memory({k: Path(v) for k, v in folders.items()}, settings, factor))"
        )
        argument = json.dumps(
            [{k: str(v) for k, v in folders.items()}, settings.model_dump_json(exclude_unset=True), factor]
        )
        result = subprocess.run(
            [sys.executable, "-c", code, argument], capture_output=True, text=True, check=True
        )
        peaks.append(float(result.stdout.split()[-1]))
    return [
        Measure(f"{domain}_rollouts_peak_memory", peaks[0], "MB"),
        Measure(f"{domain}_rollouts_peak_memory_ratio_8_times_the_hits", peaks[1] / peaks[0], "1"),
    ]


def peak_memory(folders: Mapping[str, Path], settings: str, factor: int) -> float:
    """Peak memory in MB of this process after rolling out `factor` times 4096 hits; `settings` is JSON."""
    few = RolloutsSettings.from_parts(
        RolloutsSettings.model_validate_json(settings),
        train=64 * factor,
        validation=1,
        test=1,
        hits=64,
        named_conditions={},
    )
    with tempfile.TemporaryDirectory() as folder:
        simulate(few, folders, Path(folder), 2)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def training_measures(
    domain: str, method_name: str, settings: MethodSettings, training: DomainTraining, action: int
) -> list[Measure]:
    """Seconds of a training step of a job at the configured sizes, and the speed-up over a plain loop.

    The plain loop trains one model after the other and processes a sequence sample by sample.
    """
    models = -(-training.models // training.jobs)
    together = _training_step(method_name, settings, training, action, models)
    alone = _training_step(method_name, settings, training, action, 1, plain=True)
    together()
    fast = min(seconds(together) for _ in range(5))
    slow = min(seconds(lambda: [alone() for _ in range(models)]) for _ in range(3))
    return [
        Measure(f"{domain}_{method_name}_training_step", fast, "s"),
        Measure(f"{domain}_{method_name}_training_step_ratio_to_plain_loop", slow / fast, "1"),
    ]


def _training_step(
    method_name: str,
    settings: MethodSettings,
    training: Training,
    action: int,
    models: int,
    plain: bool = False,
) -> Callable[[], None]:
    """A forward and a backward pass through random sequences."""
    generator = torch.Generator().manual_seed(0)
    method = load_method(method_name)(Sizes(2, action, 2), settings, models, generator)
    shape = (models, training.tasks, training.sequence)
    data = [torch.randn(*shape, size, generator=generator) for size in (2, action, 2)]

    def step() -> None:
        method.zero_grad()
        if plain:
            predicted = AdaptationMethod.sequence_predictions(method, *data)
        else:
            predicted = method.sequence_predictions(*data)
        method.sequence_loss(predicted, data[2]).backward()

    return step


def seconds(work: Callable[[], object]) -> float:
    """Wall time of a call, in s."""
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin
