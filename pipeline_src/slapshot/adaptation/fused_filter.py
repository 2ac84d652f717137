"""The Kalman filter over whole sequences and its adjoint, compiled for the CPU, 16 tasks at once.

The equations are derived in `slapshot.adaptation.kalman_filter`; this module is their fast implementation.
All tasks of all models are laid out in blocks of `lanes.WIDTH`, and a block runs through its whole sequence
within the processor's caches. In torch the same step takes twenty calls, each of which writes its result to
memory.
"""

from typing import Any

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn import functional

from slapshot.adaptation.kalman_filter import PlainFilterMeans
from slapshot.adaptation.lanes import WIDTH, load, product, square_root, store, transpose
from slapshot.adaptation.measurement import LARGEST_FACTOR, square, unpack, whiten

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


def filter_means(mean: Tensor, covariance: Tensor, outputs: Tensor, C: Tensor, drift: float) -> Tensor:
    """Means of phi after 0, 1, ..., N measurements, (M, B, N + 1, h).

    Args:
        mean: of the prior, (M, B, h).
        covariance: of the prior, (M, B, h, h).
        outputs: of the measurement network for N samples, (M, B, N, k + k (k + 1) / 2); see `unpack`.
        C: C_z of each model, (M, k, h).
        drift: epsilon of Q = epsilon I.
    """
    if outputs.device.type == "cpu":
        return FusedFilterMeans.apply(mean, covariance, outputs, C, drift)
    return PlainFilterMeans.apply(mean, covariance, *whiten(*unpack(outputs, C.shape[-2]), C), drift)


class FusedFilterMeans(torch.autograd.Function):
    """`filter_means` for tensors of one floating type on the CPU."""

    @staticmethod
    def forward(
        ctx: Any, mean: Tensor, covariance: Tensor, outputs: Tensor, C: Tensor, drift: float
    ) -> Tensor:
        """Arguments and result as in `filter_means`."""
        (M, B, N), (k, h) = outputs.shape[:3], C.shape[1:]
        places = square(torch.arange(k * (k + 1) // 2), k)
        raw = outputs[..., k + places.diagonal()].clamp(-LARGEST_FACTOR, LARGEST_FACTOR)
        blocks = -(-M * B // WIDTH)
        means = C.new_empty(M * B, N + 1, h)
        # Saved for the adjoint, per step and in blocks: mu, the lower triangle of Sigma, K and r. K also
        # equals Sigma H', but in float32 that loses all digits once a measurement removed most variance.
        sizes = ((h, 1), (h * (h + 1) // 2, 1), (h, k), (k, 1))
        steps = [C.new_empty(blocks, N, *size, WIDTH) for size in sizes]
        given = [x.flatten(0, 1) for x in (mean, covariance, outputs, functional.softplus(raw))]
        _filter(drift, *[_array(x) for x in (*given, places, C, means, *steps)])
        ctx.save_for_backward(outputs, raw, C, *steps)
        return means.unflatten(0, (M, B))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Adjoint of the recursion, see `PlainFilterMeans`, and of `whiten` and `unpack`."""
        outputs, raw, C, *steps = ctx.saved_tensors
        (M, B), (k, h) = outputs.shape[:2], C.shape[1:]
        places = square(torch.arange(k * (k + 1) // 2), k)
        given = [
            x.flatten(0, 1) for x in (gradients[0], outputs, functional.softplus(raw), torch.sigmoid(raw))
        ]
        per_task = [C.new_empty(M * B, *size) for size in ((h,), (h, h), outputs.shape[2:])]
        l_C = torch.zeros_like(C)
        _adjoint(*[_array(x) for x in (*given, places, C, *steps, *per_task, l_C)])
        return *(x.unflatten(0, (M, B)) for x in per_task), l_C, None


def _array(tensor: Tensor) -> NDArray[Any]:
    return tensor.detach().contiguous().numpy()


@njit(cache=True, nogil=True, error_model="numpy")
def _filter(  # type: ignore[no-untyped-def]
    drift,
    mean,
    covariance,
    outputs,
    diagonal,
    places,
    C,
    means,
    each_mean,
    each_covariance,
    each_gain,
    each_residual,
):
    """Fill `means` (T, N + 1, h) and, in blocks of tasks, the quantities of each step for the adjoint.

    Args:
        drift: epsilon.
        mean: (T, h) of the prior.
        covariance: (T, h, h) of the prior.
        outputs: (T, N, k + k (k + 1) / 2).
        diagonal: of L, (T, N, k).
        places: (k, k), index of the packed number of each entry of the lower triangle of L.
        C: (M, k, h).
        means: result.
        each_mean: mu, result, (blocks, N, h, 1, WIDTH).
        each_covariance: lower triangle of Sigma by rows, result, (blocks, N, h (h + 1) / 2, 1, WIDTH).
        each_gain: K, result, (blocks, N, h, k, WIDTH).
        each_residual: r, result, (blocks, N, k, 1, WIDTH).
    """
    samples, (k, h) = outputs.shape[1], C.shape[1:]
    like = C.reshape(-1)
    given, d, L, C_m = (
        _matrix(outputs.shape[2], 1, like),
        _matrix(k, 1, like),
        _matrix(k, k, like),
        _matrix(k, h, like),
    )
    mu, innovation = _matrix(h, 1, like), _matrix(k, 1, like)
    P, F, FP = _matrix(h, h, like), _matrix(h, h, like), _matrix(h, h, like)
    PH, H = _matrix(h, k, like), _matrix(k, h, like)
    S, L_inverse, S_inverse = _matrix(k, k, like), _matrix(k, k, like), _matrix(k, k, like)
    for block in range(each_mean.shape[0]):
        first = block * WIDTH
        _of_models(C, len(mean), first, C_m)
        _to_lanes(mean, first, 0, mu)
        _to_lanes(covariance, first, 0, P)
        _from_lanes(mu, first, 0, means)
        for i in range(samples):
            K, r = each_gain[block, i], each_residual[block, i]
            _to_lanes(outputs, first, i, given)
            _to_lanes(diagonal, first, i, d)
            _unpack(given, d, places, L)
            _transpose_times(H, L, C_m)
            _transpose_times(innovation, L, given[:k])
            _subtract_times(innovation, H, mu)
            _add_to_diagonal(P, drift)
            _times_transpose(PH, P, H)
            _lower_times(S, H, PH)
            _add_to_diagonal(S, 1.0)
            _invert(S, L_inverse, S_inverse)
            _times(K, PH, S_inverse)
            _add_times(mu, K, innovation)
            _times(r, S_inverse, innovation)
            _shrinkage(F, K, H)
            _times(FP, F, P)
            _lower_times_transpose(P, FP, F)
            _add_lower_times_transpose(P, K, K)
            _mirror(P)
            _pack_symmetric(P, each_covariance[block, i])
            _copy(each_mean[block, i], mu)
            _from_lanes(mu, first, i + 1, means)


@njit(cache=True, nogil=True, error_model="numpy")
def _adjoint(  # type: ignore[no-untyped-def]
    gradient,
    outputs,
    diagonal,
    slope,
    places,
    C,
    each_mean,
    each_covariance,
    each_gain,
    each_residual,
    l_mean,
    l_covariance,
    l_outputs,
    l_C,
):
    """Fill the gradients `l_mean`, ... with respect to `mean`, ... of `_filter`, and add to `l_C`.

    `gradient` (T, N + 1, h) is dL/dmeans; the gradients with respect to the mean and the covariance of
    one step are `l_mu` and G, as l and G in `PlainFilterMeans`. `slope` is the derivative of softplus.
    From y = L' mu_z and H = L' C follow

        dL/dmu_z = L dL/dy,   dL/dL = mu_z dL/dy' + C dL/dH',   dL/dC = L dL/dH
    """
    samples, (k, h) = outputs.shape[1], C.shape[1:]
    size, like = outputs.shape[2], C.reshape(-1)
    given, l_given, L, l_L = (
        _matrix(size, 1, like),
        _matrix(size, 1, like),
        _matrix(k, k, like),
        _matrix(k, k, like),
    )
    d, d_slope, C_m, l_C_m = (
        _matrix(k, 1, like),
        _matrix(k, 1, like),
        _matrix(k, h, like),
        _matrix(k, h, like),
    )
    l_mu, a, l_y = _matrix(h, 1, like), _matrix(h, 1, like), _matrix(k, 1, like)
    Sigma_l, H_r = _matrix(h, 1, like), _matrix(h, 1, like)
    Sigma, G = _matrix(h, h, like), _matrix(h, h, like)
    GF, F = _matrix(h, h, like), _matrix(h, h, like)
    H, KG, l_H = _matrix(k, h, like), _matrix(k, h, like), _matrix(k, h, like)
    for block in range(each_mean.shape[0]):
        first = block * WIDTH
        _of_models(C, len(gradient), first, C_m)
        _to_lanes(gradient, first, samples, l_mu)
        G[:] = 0
        l_C_m[:] = 0
        for i in range(samples - 1, -1, -1):
            K, r = each_gain[block, i], each_residual[block, i]
            _unpack_symmetric(each_covariance[block, i], Sigma)
            _to_lanes(outputs, first, i, given)
            _to_lanes(diagonal, first, i, d)
            _unpack(given, d, places, L)
            _transpose_times(H, L, C_m)
            _shrinkage(F, K, H)
            _transpose_times(l_y, K, l_mu)
            _transpose_times(a, F, l_mu)
            _times(Sigma_l, Sigma, l_mu)
            _transpose_times(KG, K, G)
            _times_minus_two(l_H, KG, Sigma)
            _add_times_transpose(l_H, r, Sigma_l)
            _subtract_times_transpose(l_H, l_y, each_mean[block, i])
            _times(l_given[:k], L, l_y)
            _lower_times_transpose(l_L, C_m, l_H)
            _add_lower_times_transpose(l_L, given[:k], l_y)
            _add_times(l_C_m, L, l_H)
            _to_lanes(slope, first, i, d_slope)
            _pack(l_L, given, d_slope, places, l_given)
            _from_lanes(l_given, first, i, l_outputs)
            _transpose_times(H_r, H, r)
            _times(GF, G, F)
            _lower_transpose_times(G, F, GF)
            _add_half_lower_times_transpose(G, a, H_r)
            _add_half_lower_times_transpose(G, H_r, a)
            _mirror(G)
            _to_lanes(gradient, first, i, l_mu)
            _add(l_mu, a)
        _from_lanes(l_mu, first, 0, l_mean)
        _from_lanes(G, first, 0, l_covariance)
        _add_to_models(l_C_m, len(gradient), first, l_C)


@njit(error_model="numpy")
def _unpack(given, diagonal, places, L):  # type: ignore[no-untyped-def]
    """Fill L from the outputs (k + k (k + 1) / 2, 1, WIDTH) and its diagonal."""
    k = L.shape[0]
    L[:] = 0
    for i in range(k):
        for j in range(i):
            store(L, i, j, load(given, k + places[i, j], 0))
    numbers, bound = L.reshape(-1), L.dtype.type(LARGEST_FACTOR)
    for n in range(numbers.size):
        numbers[n] = bound if numbers[n] > bound else -bound if numbers[n] < -bound else numbers[n]
    for i in range(k):
        store(L, i, i, load(diagonal, i, 0))


@njit(error_model="numpy")
def _pack(l_L, given, slope, places, l_given):  # type: ignore[no-untyped-def]
    """Gradient with respect to the outputs that `_unpack` turns into L; 0 for clipped entries."""
    k = l_L.shape[0]
    for i in range(k):
        for j in range(i):
            store(l_given, k + places[i, j], 0, load(l_L, i, j))
        store(l_given, k + places[i, i], 0, load(l_L, i, i) * load(slope, i, 0))
    numbers, gradient = given.reshape(-1)[k * WIDTH :], l_given.reshape(-1)[k * WIDTH :]
    bound, zero = l_L.dtype.type(LARGEST_FACTOR), l_L.dtype.type(0)  # a plain 0 would make it float64
    for n in range(numbers.size):
        gradient[n] = zero if abs(numbers[n]) > bound else gradient[n]


@njit(error_model="numpy")
def _pack_symmetric(X, triangle):  # type: ignore[no-untyped-def]
    """Copy the lower triangle of X row by row."""
    n = 0
    for i in range(X.shape[0]):
        for j in range(i + 1):
            store(triangle, n, 0, load(X, i, j))
            n += 1


@njit(error_model="numpy")
def _unpack_symmetric(triangle, X):  # type: ignore[no-untyped-def]
    """Undo `_pack_symmetric`."""
    n = 0
    for i in range(X.shape[0]):
        for j in range(i + 1):
            store(X, i, j, load(triangle, n, 0))
            n += 1
    _mirror(X)


@njit(error_model="numpy")
def _of_models(C, tasks, first, target):  # type: ignore[no-untyped-def]
    """Copy the matrix of each task's model, from C (M, k, h), to the task's lane of (k, h, WIDTH)."""
    for lane in range(WIDTH):
        model = min(first + lane, tasks - 1) * len(C) // tasks
        for i in range(C.shape[1]):
            for j in range(C.shape[2]):
                target[i, j, lane] = C[model, i, j]


@njit(error_model="numpy")
def _add_to_models(source, tasks, first, C):  # type: ignore[no-untyped-def]
    """Add the tasks' matrices (k, h, WIDTH) to those of their models (M, k, h)."""
    for lane in range(min(WIDTH, tasks - first)):
        model = (first + lane) * len(C) // tasks
        for i in range(C.shape[1]):
            for j in range(C.shape[2]):
                C[model, i, j] += source[i, j, lane]


@njit(error_model="numpy")
def _matrix(rows, columns, like):  # type: ignore[no-untyped-def]
    """Empty (rows, columns, WIDTH) aligned to cache lines: an entry across two takes twice as long."""
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
    """Copy the lower triangle of X to its upper one."""
    for i in range(X.shape[0]):
        for j in range(i):
            store(X, j, i, load(X, i, j))


@njit(error_model="numpy")
def _invert(S, L_inverse, S_inverse):  # type: ignore[no-untyped-def]
    """Inverse of S = L L'; the lower triangle of S is given and is overwritten by L.

    No eigenvalue of S is below 1, so only non-finite inputs could fail here, and they show in the result.
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
    """Copy element i of WIDTH tasks of `source` (T, ...), from `first` on, to `target` (..., WIDTH).

    Lanes without a task repeat the last one, so that they hold ordinary numbers.
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
    """Copy `source` (..., WIDTH) to element i of the tasks of `target` (T, ...), from `first` on."""
    tasks, size = target.shape[0], source.size // WIDTH
    step = target.size // tasks
    whole = size - size % WIDTH if first + WIDTH <= tasks else 0
    for begin in range(0, whole, WIDTH):
        transpose(source, begin * WIDTH, WIDTH, target, first * step + i * size + begin, step)
    lanes, numbers = source.reshape(-1), target.reshape(-1)
    for lane in range(min(WIDTH, tasks - first)):
        for n in range(whole, size):
            numbers[(first + lane) * step + i * size + n] = lanes[n * WIDTH + lane]
