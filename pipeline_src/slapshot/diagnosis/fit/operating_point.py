"""The operating point of a linearisation: a hypothesis at some values about a trajectory, simulated once.

Linearisations about one point follow one another, with other columns each: of errors of laws, of a
hypothesis, of all candidates. What they share is kept.
"""

from dataclasses import fields
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.fit.derivatives import Midpoint
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments, steps_between

_STEP = 1e-6  # of differences of observations
_OF_THE_STATE = (int(mujoco.mjtSensor.mjSENS_JOINTPOS), int(mujoco.mjtSensor.mjSENS_JOINTVEL))
_KEPT = 3  # points of a simulator
_FIELDS = [field.name for field in fields(Segments) if field.name != "y"]  # readings decide nothing here


class Jacobian(NamedTuple):
    """Derivatives of n intervals, see `Linear`: (n, dim, dim), (n, dim, nv), (n, ny, dim), (n, dim, dim)."""

    A: Array
    B: Array
    C: Array
    spread: Array
    process: Array | None


class OperatingPoint:
    """A hypothesis at some values about a trajectory, simulated from each of its n = S L nodes to the next.

    Args:
        simulator: of the hypothesis' rig.
        hypothesis: effects that are present.
        theta: their values.
        segments: data.
        trajectory: (S, L, nq + nv + na).
        torque_scale: (nv,) size of forces, for differences.
    """

    def __init__(
        self,
        simulator: Simulator,
        hypothesis: Hypothesis,
        theta: Array,
        segments: Segments,
        trajectory: Array,
        torque_scale: Array,
    ) -> None:
        (S, L), self.segments = segments.shape, segments
        self.simulator, self.hypothesis, self.theta = simulator, hypothesis, theta.copy()
        self.torque_scale = torque_scale
        self.x = trajectory.reshape(S * L, -1).copy()
        self.time, self.order = segments.time.reshape(S * L), np.repeat(segments.order, L)
        self.model = hypothesis.compiled(theta, segments.step)
        self.control = hypothesis.control(segments, theta).reshape(S * L, segments.substeps, -1)
        self.reads_joints = _reads_joints(hypothesis.rig)
        # Next states, and observations and actuator forces of these.
        self.end, self.y, self.torque = self.advance(hypothesis, theta, self.model, self.x, self.control)

    @classmethod
    def at(
        cls,
        simulator: Simulator,
        hypothesis: Hypothesis,
        theta: Array,
        segments: Segments,
        trajectory: Array,
        torque_scale: Array,
    ) -> "OperatingPoint":
        """The point, which may be one of the last that this was called for."""
        kept = simulator.kept
        for point in kept:
            if point._is(hypothesis, theta, segments, trajectory, torque_scale):
                return point
        point = cls(simulator, hypothesis, theta, segments, trajectory, torque_scale)
        simulator.kept = [point, *kept[: _KEPT - 1]]
        return point

    def _is(
        self, hypothesis: Hypothesis, theta: Array, segments: Segments, trajectory: Array, torque_scale: Array
    ) -> bool:
        own, effects = self.hypothesis, hypothesis.effects
        return (
            all(getattr(self.segments, name) is getattr(segments, name) for name in _FIELDS)
            and own.rig is hypothesis.rig
            and len(own.effects) == len(effects)
            and all(one is other for one, other in zip(own.effects, effects, strict=True))
            and np.array_equal(self.theta, theta)
            and np.array_equal(self.torque_scale, torque_scale)
            and np.array_equal(self.x, trajectory.reshape(len(self.x), -1))
        )

    def advance(
        self,
        hypothesis: Hypothesis,
        theta: Array,
        model: mujoco.MjModel,
        x: Array,
        u: Array,
        extra: Array | None = None,
    ) -> tuple[Array, Array, Array]:
        """The same intervals of whatever is given, see `Simulator.advance`."""
        return self.simulator.advance(hypothesis, theta, model, x, u, self.time, self.order, extra)

    @cached_property
    def middle(self) -> Midpoint:
        """Steps in the middle of the intervals."""
        return Midpoint(
            self.simulator, self.hypothesis, self.theta, self.model, self.x, self.end, self.control,
            self.time, self.order,
        )  # fmt: skip

    @cached_property
    def jacobian(self) -> Jacobian:
        """Derivatives about the trajectory."""
        hypothesis, tangent = self.hypothesis, self.simulator.tangent
        A, spread = self.middle.transition()
        B = self.middle.force(spread, self.torque_scale)
        reference = hypothesis.compiled(hypothesis.start, self.segments.step)
        pushed = self.middle.under_process_force(reference)
        process = None if pushed is None else pushed.force(spread, self.torque_scale)
        C = np.empty((*self.y.shape, tangent.dim))
        for i in range(tangent.dim):
            delta = np.zeros(tangent.dim)
            delta[i] = _STEP
            if self.reads_joints:
                C[:, :, i] = self.simulator.read(delta) / _STEP
            else:
                C[:, :, i] = (self._observed_at(tangent.add(self.x, delta)) - self.y) / _STEP
        return Jacobian(A, B, C, spread, process)

    def _observed_at(self, states: Array) -> Array:
        """Observations at some states, without what effects add."""
        return self.advance(self.hypothesis, self.theta, self.model, states, self.control[:, :1])[1]

    @cached_property
    def halved(self) -> Array:
        """(n, dim) change of the next states with steps of half the length.

        Where a better integrator was put in place of the given one, half of the change to that one, whose
        error is in proportion to its step.
        """
        hypothesis, theta, step = self.hypothesis, self.theta, self.segments.step
        tangent, given = self.simulator.tangent, hypothesis.rig.given_integrator
        if given is None:
            finer = hypothesis.compiled(theta, step / 2)
            twice = np.repeat(self.control, 2, axis=1)
            return tangent.subtract(self.advance(hypothesis, theta, finer, self.x, twice)[0], self.end)
        model = hypothesis.compiled(theta, step)
        model.opt.integrator = given
        change = tangent.subtract(self.advance(hypothesis, theta, model, self.x, self.control)[0], self.end)
        given_steps = steps_between(self.segments.interval, hypothesis.rig.model.opt.timestep)
        change *= min(1.0, self.segments.substeps / given_steps)
        return tangent.subtract(tangent.add(self.end, change / 2), self.end)


def _reads_joints(rig: Rig) -> bool:
    """Whether only positions and velocities of joints are observed, which are part of the state."""
    read = np.flatnonzero(rig.reading.any(0))
    sensors = [int(np.flatnonzero(rig.model.sensor_adr <= address)[-1]) for address in read]
    return all(rig.model.sensor_type[sensor] in _OF_THE_STATE for sensor in sensors)
