"""Time of a forward and backward pass of the Kalman filter of training, against dynamax and plain torch."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from slapshot.adaptation.fused_filter import filter_means
from slapshot.adaptation.kalman_filter import PlainFilterMeans
from slapshot.adaptation.measurement import measurement_size, unpack, whiten
from slapshot.benchmark.measures import Measure, seconds
from slapshot.config.methods import KalmanSettings, Training
from slapshot.errors import InputError

ROUNDS = 9
TASKS = Path("/proc/self/task")


def filter_measures(domain: str, settings: KalmanSettings, training: Training) -> list[Measure]:
    """Seconds of a forward and backward pass at the configured sizes, on one core, and ratios to others.

    The plain filter is the same in calls of torch, including unpacking and whitening, as in the compiled one.
    dynamax's gets whitened measurements, and is compiled beforehand. `difference_to_dynamax` is the largest
    difference of means and gradients, relative to the largest entry of each.

    Args:
        domain: its name in the configuration.
        settings: of the Kalman method.
        training: sizes of the training.

    Raises:
        InputError: dynamax is not installed.
    """
    h, drift = settings.latent, settings.drift
    generator = torch.Generator().manual_seed(0)

    def normal(*size: int) -> Tensor:
        return torch.randn(training.models, *size, generator=generator)

    # The last sample of a sequence is only predicted, never adapted to.
    B, N = training.tasks, training.sequence - 1
    mean, covariance = normal(B, h), torch.eye(h).expand(training.models, B, h, h).contiguous()
    outputs, C = normal(B, N, measurement_size(h)), torch.eye(h) + 0.01 * normal(h, h)
    weights = normal(B, N + 1, h)
    y, H = whiten(*unpack(outputs, h), C)

    def compiled(mean: Tensor, covariance: Tensor, outputs: Tensor, C: Tensor) -> Tensor:
        return filter_means(mean, covariance, outputs, C, drift)

    def plain(mean: Tensor, covariance: Tensor, outputs: Tensor, C: Tensor) -> Tensor:
        return PlainFilterMeans.apply(mean, covariance, *whiten(*unpack(outputs, h), C), drift)

    def on_whitened(mean: Tensor, covariance: Tensor, y: Tensor, H: Tensor) -> Tensor:
        return PlainFilterMeans.apply(mean, covariance, y, H, drift)

    # Before the pinning: with a pool of one thread jax waits for itself now and then, and never ends.
    need_dynamax()[0].devices()
    with one_core():
        dynamax = _Dynamax((mean, covariance, y, H), weights, drift)
        passes: dict[str, Callable[[], Any]] = {
            "slapshot": lambda: _both_ways(compiled, (mean, covariance, outputs, C), weights),
            "plain": lambda: _both_ways(plain, (mean, covariance, outputs, C), weights),
            "dynamax": dynamax.run,
        }
        for run in passes.values():
            run()  # compiles
        # Interleaved, minimum of each: load from other processes then slows all alike.
        rounds = [{name: seconds(run) for name, run in passes.items()} for _ in range(ROUNDS)]
        expected = _both_ways(on_whitened, (mean, covariance, y, H), weights)
        difference = max(
            float((a - b).abs().max() / b.abs().max())
            for a, b in zip(dynamax.both_ways(), expected, strict=True)
        )
    best = {name: min(r[name] for r in rounds) for name in passes}
    name = f"{domain}_kalman_filter"
    return [
        Measure(name, best["slapshot"], "s"),
        Measure(f"{name}_ratio_to_plain", best["plain"] / best["slapshot"], "1"),
        Measure(f"{name}_dynamax", best["dynamax"], "s"),
        Measure(f"{name}_ratio_to_dynamax", best["dynamax"] / best["slapshot"], "1"),
        Measure(f"{name}_difference_to_dynamax", difference, "1"),
    ]


@contextmanager
def one_core() -> Iterator[None]:
    """Pin all threads of this process, and those that they start, to one core, where the system is Linux."""
    if not TASKS.is_dir():
        yield
        return
    cores = os.sched_getaffinity(0)
    _pin({max(cores)})
    try:
        yield
    finally:
        _pin(cores)


def _pin(cores: set[int]) -> None:
    for task in TASKS.iterdir():
        with suppress(ProcessLookupError):  # a thread that has ended
            os.sched_setaffinity(int(task.name), cores)


def need_dynamax() -> tuple[Any, Any]:
    """The modules jax and dynamax.linear_gaussian_ssm.inference.

    Raises:
        InputError: the extra is not installed.
    """
    try:
        return import_module("jax"), import_module("dynamax.linear_gaussian_ssm.inference")
    except ModuleNotFoundError as error:
        install = "pip install --require-hashes --requirement requirements/benchmark.txt"
        raise InputError(f"benchmark: dynamax is not installed; run: {install}") from error


def _both_ways(
    function: Callable[..., Tensor], arguments: tuple[Tensor, ...], weights: Tensor
) -> list[Tensor]:
    """Means after 0, ..., N measurements, and the gradients of their weighted sum."""
    inputs = [x.detach().requires_grad_() for x in arguments]
    means = function(*inputs)
    return [means.detach(), *torch.autograd.grad(means, inputs, weights)]


class _Dynamax:
    """dynamax's filter on the same arguments, compiled for all tasks at once."""

    def __init__(self, arguments: tuple[Tensor, ...], weights: Tensor, drift: float):
        self.jax, inference = need_dynamax()
        identity = self.jax.numpy.eye(weights.shape[-1])

        def task(mean: Any, covariance: Any, y: Any, H: Any) -> Any:
            # Its first measurement precedes any drift, ours follows the first drift.
            parameters = inference.make_lgssm_params(
                mean, covariance + drift * identity, identity, drift * identity, H, identity
            )
            return inference.lgssm_filter(parameters, y).filtered_means

        def loss(weights: Any, *arguments: Any) -> Any:
            means = self.jax.vmap(task)(*arguments)
            return (weights * means).sum(), means

        self.compiled = self.jax.jit(self.jax.value_and_grad(loss, argnums=(1, 2, 3, 4), has_aux=True))
        self.prior, self.weights = arguments[0], weights
        # It does not return the mean before any measurement.
        self.arguments = [self._array(x) for x in (weights[:, :, 1:], *arguments)]

    def _array(self, tensor: Tensor) -> Any:
        return self.jax.numpy.asarray(tensor.flatten(0, 1).numpy())

    def run(self) -> Any:
        return self.jax.block_until_ready(self.compiled(*self.arguments))

    def both_ways(self) -> list[Tensor]:
        """As `_both_ways`."""
        (_, means), gradients = self.run()
        means, l_mean, l_covariance, *rest = (
            torch.from_numpy(np.array(x)).unflatten(0, self.prior.shape[:2]) for x in (means, *gradients)
        )
        means = torch.cat([self.prior[:, :, None], means], dim=2)
        # It differentiates with respect to a general matrix; for a symmetric one, take the symmetric part.
        l_covariance = 0.5 * (l_covariance + l_covariance.mT)
        return [means, l_mean + self.weights[:, :, 0], l_covariance, *rest]
