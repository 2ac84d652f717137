"""Derivatives of an interval of simulation, from those of one model step in its middle.

About the state in the middle of an interval of k steps, a small change of state grows by A₁ᵏ, where A₁ is
that of one step; what is left out is of second order in the interval. A₁ is a difference of steps, or for
Runge and Kutta's method, whose steps take four evaluations each, its stability polynomial Σ (hJ)ᵐ/m! for m up
to 4, with J the derivative of the right-hand side, for which one evaluation is enough.
"""

import copy
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator

_POSITION_STEP, _VELOCITY_STEP = 1e-6, 1e-5
_FORCE_STEP = 1e-2  # share of the rms torque
# Entries of a transition that nothing has but a stop which one of two states hits and the other misses; and
# the steps, in those above, over which such intervals are differenced.
_JUMP, _WIDE = 1e4, 100.0
# Speeds below this many times what an interval changes, or friction's constraint stops, are near rest.
_MARGIN = 2.0
_INERTIA = "body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_armature"


class Midpoint:
    """One model step from the middle of each of n intervals, and the propagation of changes to their ends.

    Args:
        simulator: of the hypothesis' rig.
        hypothesis: effects that are present.
        theta: their values.
        model: compiled with them.
        x: (n, nq + nv + na) states where the intervals begin.
        end: (n, nq + nv + na) states where they lead.
        u: (n, steps, nu) controls.
        time: (n,) s, where they begin.
        order: (n,) place in the session.
    """

    def __init__(
        self,
        simulator: Simulator,
        hypothesis: Hypothesis,
        theta: Array,
        model: mujoco.MjModel,
        x: Array,
        end: Array,
        u: Array,
        time: Array,
        order: Array,
    ) -> None:
        self._simulator, self._tangent, self._steps = simulator, simulator.tangent, u.shape[1]
        self._smooth = _is_smooth(model)
        # In the middle of the interval, or of the states from which its steps are taken.
        share = 0.5 if self._smooth else (self._steps - 1) / (2 * self._steps)
        self._way = self._tangent.subtract(end, x)
        self._x = self._tangent.add(x, share * self._way)
        self._h = float(model.opt.timestep)
        self._time, self._order = time + share * self._steps * self._h, order
        self._whole = x, end, u, time
        self._u = u.mean(axis=1, keepdims=True)
        self._hypothesis, self._theta = hypothesis, theta
        self._given, self._model = model, _explicit(model) if self._smooth else model

    @cached_property
    def _end(self) -> Array:
        return self._step(self._hypothesis, self._theta, self._model, self._x, self._u)

    def _step(
        self,
        hypothesis: Hypothesis,
        theta: Array,
        model: mujoco.MjModel,
        x: Array,
        u: Array,
        extra: Array | None = None,
    ) -> Array:
        moved, _, _ = self._simulator.advance(hypothesis, theta, model, x, u, self._time, self._order, extra)
        return moved

    def _change(self, moved: Array) -> Array:
        """Of the state after a step, or of the right-hand side, where a step leads elsewhere, (n, dim)."""
        change = self._tangent.subtract(moved, self._end)
        return self._rate(change) if self._smooth else change

    def _rate(self, change: Array) -> Array:
        """Change of the right-hand side, from that of an explicit step.

        The new velocity moves the position in that step already.
        """
        nv, rate = self._tangent.nv, change / self._h
        rate[:, :nv] -= self._h * rate[:, nv : 2 * nv]
        return rate

    def transition(self) -> tuple[Array, Array]:
        """Transition over the interval, (n, dim, dim), and the accumulation of changes in every step.

        The second matrix maps a change in every step to a change of the state at the end.
        """
        nv, dim = self._tangent.nv, self._tangent.dim
        n = len(self._x)
        J = np.empty((n, dim, dim))
        for i in range(dim):
            delta = np.zeros(dim)
            delta[i] = _POSITION_STEP if i < nv else _VELOCITY_STEP
            moved = self._step(
                self._hypothesis, self._theta, self._model, self._tangent.add(self._x, delta), self._u
            )
            change = self._tangent.subtract(moved, self._end)
            if self._smooth:
                change = self._rate(change - delta)
                # A velocity moves the position; the step says so twice.
                if nv <= i < 2 * nv:
                    change[:, :nv] = 0.0
                    change[:, i - nv] = delta[i]
                elif i < nv:
                    change[:, :nv] = 0.0
            J[:, :, i] = change / delta[i]
        one = np.eye(dim)
        if self._smooth:
            hJ = self._h * J
            share = one + hJ @ (one / 2 + hJ @ (one / 6 + hJ / 24))
            A, spread = _powers(one + hJ @ share, self._steps, self._h * share)
        else:
            A, spread = _powers(J, self._steps, np.broadcast_to(one, J.shape))
        jumps = np.flatnonzero(~(np.abs(A).max(axis=(1, 2)) < _JUMP))
        if len(jumps):
            A[jumps] = self._over(jumps)
            step = self._h if self._smooth else 1.0
            spread[jumps] = self._steps * step * (one + A[jumps]) / 2
        return A, spread

    def _over(self, some: NDArray[np.intp]) -> Array:
        """Transition over some intervals, (k, dim, dim), by wide differences of simulations."""
        x, end, u, time = (array[some] for array in self._whole)
        dim, nv = self._tangent.dim, self._tangent.nv
        A = np.empty((len(some), dim, dim))
        for i in range(dim):
            delta = np.zeros(dim)
            delta[i] = _WIDE * (_POSITION_STEP if i < nv else _VELOCITY_STEP)
            moved, _, _ = self._simulator.advance(
                self._hypothesis, self._theta, self._given, self._tangent.add(x, delta), u, time,
                self._order[some],
            )  # fmt: skip
            A[:, :, i] = self._tangent.subtract(moved, end) / delta[i]
        return A

    def force(self, spread: Array, scale: Array) -> Array:
        """Effect of forces held over the interval on the state at its end, (n, dim, nv), for sizes (nv,)."""
        nv = self._tangent.nv
        columns = []
        for j in range(nv):
            force = np.zeros((len(self._x), nv))
            force[:, j] = _FORCE_STEP * scale[j]
            moved = self._step(self._hypothesis, self._theta, self._model, self._x, self._u, force)
            columns.append(self._change(moved) / (_FORCE_STEP * scale[j]))
        return np.asarray(spread @ np.stack(columns, axis=-1))

    def under_process_force(self, reference: mujoco.MjModel) -> "Midpoint | None":
        """The same for a process force; None where it acts as any force.

        It moves joints that friction holds, since laws of friction have errors too. And it acts on the
        inertia of a reference: were its effect to grow as a fitted mass shrinks, the mass would be fitted to
        the size of what the model lacks.
        """
        same = all(np.array_equal(getattr(reference, of), getattr(self._model, of)) for of in _INERTIA)
        if same and not self._model.dof_frictionloss.any():
            return None
        other = copy.copy(self)
        other.__dict__.pop("_end", None)
        other._model = copy.copy(_explicit(reference) if self._smooth else reference)
        other._model.dof_frictionloss[:] = 0
        return other

    def changed(self, hypothesis: Hypothesis, theta: Array, model: mujoco.MjModel, spread: Array) -> Array:
        """Difference of the state at the end under another hypothesis and model, (n, dim)."""
        model = _explicit(model) if self._smooth else model
        change = self._change(self._step(hypothesis, theta, model, self._x, self._u))
        return np.asarray((spread @ change[..., None])[..., 0])

    def may_stop(self, model: mujoco.MjModel) -> NDArray[np.bool_]:
        """Intervals (n,) in which a joint with dry friction in a model may stop, start or turn around.

        In all others dry friction is a constant force. A joint must be faster for that than an interval
        changes its speed, and than MuJoCo's constraint can stop it by this friction within its time constant.
        """
        nq, nv = self._tangent.nq, self._tangent.nv
        speed = self._x[:, nq : nq + nv]
        change = np.abs(self._way[:, nv : 2 * nv])
        rubs = np.flatnonzero(model.dof_frictionloss > 0)
        stops = model.dof_frictionloss * model.dof_invweight0 * _stopping_time(model)
        return np.asarray(np.any(np.abs(speed[:, rubs]) < _MARGIN * (change + stops)[:, rubs], axis=1))

    def control_response(self, difference: Array, A: Array, spread: Array) -> Array:
        """Difference of the state at the end under a difference (n, steps, nu) of controls, (n, dim)."""
        # Where the controls differ within the interval, relative to its middle: the state differs there, and
        # early changes grow for longer, as A to the power of a share of the interval, by its logarithm.
        size = np.abs(difference).sum(axis=2)
        ahead = ((self._steps - 1) / 2 - np.arange(self._steps)) / self._steps
        early = (size @ ahead / np.maximum(size.sum(axis=1), 1e-300))[:, None]
        x = self._tangent.add(self._x, -early * self._way)
        step = (self._hypothesis, self._theta, self._model, x)
        moved = self._step(*step, self._u + difference.mean(axis=1, keepdims=True))
        change = self._tangent.subtract(moved, self._step(*step, self._u))
        found = (spread @ (self._rate(change) if self._smooth else change)[..., None])[..., 0]
        rest = A - np.eye(A.shape[-1])
        once = np.einsum("nij,nj->ni", rest, found)
        return np.asarray(found + early * (once - 0.5 * np.einsum("nij,nj->ni", rest, once)))


def _stopping_time(model: mujoco.MjModel) -> Array:
    """(nv,) s in which the constraint of dry friction brings a joint to rest that nothing else moves."""
    solref, width = model.dof_solref, model.dof_solimp[:, 1]
    direct = solref[:, 1] < 0
    return np.where(direct, -1 / np.where(direct, solref[:, 1], -1.0), width * solref[:, 0] / 2)


def _is_smooth(model: mujoco.MjModel) -> bool:
    """Whether steps are those of Runge and Kutta's method, on coordinates that add."""
    return bool(model.opt.integrator == int(mujoco.mjtIntegrator.mjINT_RK4) and model.nq == model.nv)


def _explicit(model: mujoco.MjModel) -> mujoco.MjModel:
    """The model with Euler's method, damping explicit: its velocity change gives the acceleration."""
    model = copy.copy(model)
    model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_EULER)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    return model


def _powers(one: Array, steps: int, spread: Array) -> tuple[Array, Array]:
    """A = A₁ᵏ, and Σ A₁ʲ Φ for j below k."""
    A, total = one, spread
    for _ in range(steps - 1):
        A, total = one @ A, one @ total + spread
    return A, np.array(total)
