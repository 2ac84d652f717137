"""The Kalman filter over whole sequences and its adjoint, compiled for the CPU, 16 tasks at once.

The equations are those of `slapshot.adaptation.kalman_filter`, which says what they are; this is how they run
fast. All tasks of all models are laid out in blocks of `lanes.WIDTH`, and a block goes through its sequence
within the processor's caches. What torch does with the same matrices is twenty calls a step, each of which
writes its result to memory.
"""

from typing import Any

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import once_differentiable

from slapshot.adaptation.lanes import WIDTH, load, product, square_root, store, transpose

Array = NDArray[np.floating]

_times = product()
_add_times = product(add=True)
_subtract_times = product(scale=-1.0, add=True)
_times_minus_two = product(scale=-2.0)
_times_transpose = product(transpose_b=True)
_add_times_transpose = product(transpose_b=True, add=True)
_subtract_times_transpose = product(transpose_b=True, scale=-1.0, add=True)
_transpose_times = product(transpose_a=True)
_lower_times = product(lower=True)
_lower_times_transpose = product(transpose_b=True, lower=True)
_add_lower_times_transpose = product(transpose_b=True, add=True, lower=True)
_add_half_lower_times_transpose = product(transpose_b=True, scale=0.5, add=True, lower=True)
_lower_transpose_times = product(transpose_a=True, lower=True)


class FusedFilterMeans(torch.autograd.Function):
    """`kalman_filter.filter_means` for tensors of one floating type on the CPU."""

    @staticmethod
    def forward(ctx: Any, mean: Tensor, covariance: Tensor, y: Tensor, H: Tensor, drift: float) -> Tensor:
        """Arguments and result as in `kalman_filter.filter_means`."""
        M, B, N, k, h = H.shape
        blocks = -(-M * B // WIDTH)
        means = H.new_empty(M * B, N + 1, h)
        # What the adjoint needs of every step, in blocks: mu, Sigma, K and r.
        steps = [H.new_empty(blocks, N, *size, WIDTH) for size in ((h, 1), (h, h), (h, k), (k, 1))]
        given = [x.flatten(0, 1) for x in (mean, covariance, y, H)]
        _filter(drift, *[_array(x) for x in (*given, means, *steps)])
        ctx.save_for_backward(H, *steps)
        return means.unflatten(0, (M, B))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Adjoint of the recursion: see `kalman_filter.PlainFilterMeans`."""
        H, *steps = ctx.saved_tensors
        M, B, N, k, h = H.shape
        sizes = ((h,), (h, h), (N, k), (N, k, h))
        results = [H.new_empty(M * B, *size) for size in sizes]
        given = [x.flatten(0, 1) for x in (gradients[0], H)]
        _adjoint(*[_array(x) for x in (*given, *steps, *results)])
        return *(x.unflatten(0, (M, B)) for x in results), None


def _array(tensor: Tensor) -> Array:
    return tensor.detach().contiguous().numpy()


@njit(cache=True, nogil=True, error_model="numpy")
def _filter(drift, mean, covariance, y, H, means, each_mean, each_covariance, each_gain, each_residual):  # type: ignore[no-untyped-def]
    """Fill `means` (T, N + 1, h) and, in blocks of tasks, what the adjoint needs of each step.

    Args:
        drift: epsilon.
        mean: (T, h) of the prior.
        covariance: (T, h, h) of the prior.
        y: (T, N, k).
        H: (T, N, k, h).
        means: result.
        each_mean: mu, result, (blocks, N, h, 1, WIDTH).
        each_covariance: Sigma, result, (blocks, N, h, h, WIDTH).
        each_gain: K, result, (blocks, N, h, k, WIDTH).
        each_residual: r, result, (blocks, N, k, 1, WIDTH).
    """
    samples, k, h = H.shape[1:]
    numbers = H.reshape(-1)
    mu, innovation = _matrix(h, 1, numbers), _matrix(k, 1, numbers)
    P, F, FP = _matrix(h, h, numbers), _matrix(h, h, numbers), _matrix(h, h, numbers)
    PH, H_i = _matrix(h, k, numbers), _matrix(k, h, numbers)
    S, L_inverse, S_inverse = _matrix(k, k, numbers), _matrix(k, k, numbers), _matrix(k, k, numbers)
    for block in range(each_mean.shape[0]):
        first = block * WIDTH
        _to_lanes(mean, first, 0, mu)
        _to_lanes(covariance, first, 0, P)
        _from_lanes(mu, first, 0, means)
        for i in range(samples):
            Sigma, K, r = each_covariance[block, i], each_gain[block, i], each_residual[block, i]
            _to_lanes(y, first, i, innovation)
            _to_lanes(H, first, i, H_i)
            _add_to_diagonal(P, drift)
            _times_transpose(PH, P, H_i)
            _lower_times(S, H_i, PH)
            _add_to_diagonal(S, 1.0)
            _invert(S, L_inverse, S_inverse)
            _times(K, PH, S_inverse)
            _subtract_times(innovation, H_i, mu)
            _add_times(mu, K, innovation)
            _times(r, S_inverse, innovation)
            _shrinkage(F, K, H_i)
            _times(FP, F, P)
            _lower_times_transpose(Sigma, FP, F)
            _add_lower_times_transpose(Sigma, K, K)
            _mirror(Sigma)
            _copy(P, Sigma)
            _copy(each_mean[block, i], mu)
            _from_lanes(mu, first, i + 1, means)


@njit(cache=True, nogil=True, error_model="numpy")
def _adjoint(  # type: ignore[no-untyped-def]
    gradient, H, each_mean, each_covariance, each_gain, each_residual, l_mean, l_covariance, l_y, l_H
):
    """Fill the gradients `l_mean`, ... with respect to `mean`, ... of `_filter`.

    `gradient` (T, N + 1, h) is that with respect to `means`; with respect to the mean and the covariance of
    one step they are `l_mu` and G, as l and G in `kalman_filter.PlainFilterMeans`.
    """
    samples, k, h = H.shape[1:]
    numbers = H.reshape(-1)
    l_mu, a, K_l = _matrix(h, 1, numbers), _matrix(h, 1, numbers), _matrix(k, 1, numbers)
    Sigma_l, H_r = _matrix(h, 1, numbers), _matrix(h, 1, numbers)
    G, GF, F = _matrix(h, h, numbers), _matrix(h, h, numbers), _matrix(h, h, numbers)
    H_i, KG, l_H_i = _matrix(k, h, numbers), _matrix(k, h, numbers), _matrix(k, h, numbers)
    for block in range(each_mean.shape[0]):
        first = block * WIDTH
        _to_lanes(gradient, first, samples, l_mu)
        G[:] = 0
        for i in range(samples - 1, -1, -1):
            Sigma, K, r = each_covariance[block, i], each_gain[block, i], each_residual[block, i]
            _to_lanes(H, first, i, H_i)
            _shrinkage(F, K, H_i)
            _transpose_times(K_l, K, l_mu)
            _transpose_times(a, F, l_mu)
            _times(Sigma_l, Sigma, l_mu)
            _transpose_times(KG, K, G)
            _times_minus_two(l_H_i, KG, Sigma)
            _add_times_transpose(l_H_i, r, Sigma_l)
            _subtract_times_transpose(l_H_i, K_l, each_mean[block, i])
            _from_lanes(K_l, first, i, l_y)
            _from_lanes(l_H_i, first, i, l_H)
            _transpose_times(H_r, H_i, r)
            _times(GF, G, F)
            _lower_transpose_times(G, F, GF)
            _add_half_lower_times_transpose(G, a, H_r)
            _add_half_lower_times_transpose(G, H_r, a)
            _mirror(G)
            _to_lanes(gradient, first, i, l_mu)
            _add(l_mu, a)
        _from_lanes(l_mu, first, 0, l_mean)
        _from_lanes(G, first, 0, l_covariance)


@njit(error_model="numpy")
def _matrix(rows, columns, like):  # type: ignore[no-untyped-def]
    """Empty (rows, columns, WIDTH) that begins with a cache line: an entry across two takes twice as long."""
    size = rows * columns * WIDTH
    numbers = np.empty(size + WIDTH, like.dtype)
    begin = -(numbers.ctypes.data // numbers.itemsize) % WIDTH
    return numbers[begin : begin + size].reshape(rows, columns, WIDTH)


@njit(error_model="numpy")
def _shrinkage(F, K, H):  # type: ignore[no-untyped-def]
    """F = I - K H."""
    F[:] = 0
    _add_to_diagonal(F, 1.0)
    _subtract_times(F, K, H)


@njit(error_model="numpy")
def _add_to_diagonal(X, value):  # type: ignore[no-untyped-def]
    for i in range(X.shape[0]):
        for task in range(WIDTH):
            X[i, i, task] += X.dtype.type(value)


@njit(error_model="numpy")
def _copy(target, source):  # type: ignore[no-untyped-def]
    for i in range(target.shape[0]):
        for j in range(target.shape[1]):
            store(target, i, j, load(source, i, j))


@njit(error_model="numpy")
def _add(target, source):  # type: ignore[no-untyped-def]
    for i in range(target.shape[0]):
        for j in range(target.shape[1]):
            store(target, i, j, load(target, i, j) + load(source, i, j))


@njit(error_model="numpy")
def _mirror(X):  # type: ignore[no-untyped-def]
    """Make X symmetric from its lower triangle."""
    for i in range(X.shape[0]):
        for j in range(i):
            store(X, j, i, load(X, i, j))


@njit(error_model="numpy")
def _invert(S, L_inverse, S_inverse):  # type: ignore[no-untyped-def]
    """Inverse of S = L L', of which the lower triangle is given and is overwritten by L.

    No eigenvalue of S is below 1, so only inputs that are not finite could fail here, and they show in the
    result.
    """
    k = S.shape[0]
    L_inverse[:] = 0
    _add_to_diagonal(L_inverse, 1.0)
    for j in range(k):
        pivot = load(S, j, j)
        for n in range(j):
            pivot = pivot - load(S, j, n) * load(S, j, n)
        store(L_inverse, j, j, load(L_inverse, j, j) / square_root(pivot))
        for i in range(j + 1, k):
            entry = load(S, i, j)
            for n in range(j):
                entry = entry - load(S, i, n) * load(S, j, n)
            store(S, i, j, entry * load(L_inverse, j, j))
    for i in range(k):
        for j in range(i):
            entry = load(L_inverse, i, j)
            for n in range(j, i):
                entry = entry - load(S, i, n) * load(L_inverse, n, j)
            store(L_inverse, i, j, entry * load(L_inverse, i, i))
    _lower_transpose_times(S_inverse, L_inverse, L_inverse)
    _mirror(S_inverse)


@njit(error_model="numpy")
def _to_lanes(source, first, i, target):  # type: ignore[no-untyped-def]
    """Copy part i of the tasks from `first` on, of `source` (T, ...), to `target` (..., WIDTH).

    Lanes without a task take the last one, so that nothing they hold is out of the ordinary.
    """
    tasks, size = source.shape[0], target.size // WIDTH
    step = source.size // tasks
    whole = size - size % WIDTH if first + WIDTH <= tasks else 0
    for begin in range(0, whole, WIDTH):
        transpose(source, first * step + i * size + begin, step, target, begin * WIDTH, WIDTH)
    numbers, lanes = source.reshape(-1), target.reshape(-1)
    for lane in range(WIDTH):
        task = min(first + lane, tasks - 1)
        for n in range(whole, size):
            lanes[n * WIDTH + lane] = numbers[task * step + i * size + n]


@njit(error_model="numpy")
def _from_lanes(source, first, i, target):  # type: ignore[no-untyped-def]
    """Copy `source` (..., WIDTH) to part i of the tasks from `first` on, of `target` (T, ...)."""
    tasks, size = target.shape[0], source.size // WIDTH
    step = target.size // tasks
    whole = size - size % WIDTH if first + WIDTH <= tasks else 0
    for begin in range(0, whole, WIDTH):
        transpose(source, begin * WIDTH, WIDTH, target, first * step + i * size + begin, step)
    lanes, numbers = source.reshape(-1), target.reshape(-1)
    for lane in range(min(WIDTH, tasks - first)):
        for n in range(whole, size):
            numbers[(first + lane) * step + i * size + n] = lanes[n * WIDTH + lane]
