"""What is to be explained: segments of a recording, the nominal rig, and all that might be missing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.filter import Linear, innovations
from slapshot.diagnosis.fit import Fit, Fitter
from slapshot.diagnosis.free_forms import free_forms, is_free
from slapshot.diagnosis.hypothesis import Hypothesis, Simulator, actuator_torque
from slapshot.diagnosis.inference.scores import Scores, scores
from slapshot.diagnosis.law_columns import LawColumns, law_columns
from slapshot.diagnosis.law_error import law_errors
from slapshot.diagnosis.linear import STEP_ERROR, Look, looks_at
from slapshot.diagnosis.noise import Noise, first_noise, fit_noise, fit_process_force
from slapshot.diagnosis.path import recorded_path
from slapshot.diagnosis.pulses import Scan, scan
from slapshot.diagnosis.rig import Rig
from slapshot.diagnosis.segments import Segments
from slapshot.diagnosis.situation import situation, torque_scale
from slapshot.diagnosis.structure import moved_path, moved_situation, restructured, steps_in
from slapshot.effects.joints.catalogue import instances
from slapshot.effects.joints.effect import JointEffect, Situation, State
from slapshot.effects.joints.split import FASTEST
from slapshot.recordings.channels import Channel

NUISANCE = (STEP_ERROR,)  # of every hypothesis, beside errors of laws
POSITION_SPREAD = 0.05  # rad or m, by which a first state may lie off the path
_TIGHTEN = 3  # rms speeds
_DRIFT_WIDTH = 0.1  # of the session, in which drift changes its course
_SAME = 1e-9  # rms of shapes of drift where there is but one episode


@dataclass(frozen=True)
class Problem:
    """Segments to be explained.

    Attributes:
        rig: nominal, or restructured.
        channels: what was recorded.
        segments: data.
        situation: scales of the motion.
        path: where fits begin.
        laws: looks at the shapes of errors of each law of the nominal model.
        threads: for simulation.
        fine: whether errors of laws are large enough for all their shapes to matter.
        law_columns_told: columns of errors of laws that were chosen before; None where none were.
    """

    rig: Rig
    channels: dict[str, Channel]
    segments: Segments
    situation: Situation
    path: Array
    torque: Array
    laws: tuple[Sequence[Look], ...]
    threads: int = 1
    fine: bool = False
    law_columns_told: LawColumns | None = None

    @classmethod
    def of(cls, rig: Rig, channels: dict[str, Channel], segments: Segments, threads: int = 1) -> "Problem":
        """The problem of segments as they were recorded."""
        path = recorded_path(rig, segments)
        scales = situation(rig, segments, path)
        torque = torque_scale(rig, segments, path)
        laws = _laws(rig, segments, scales, path)
        return cls(rig, channels, segments, scales, path, torque, laws, threads)

    def restructured(self, effect: JointEffect, path: Array) -> "Problem":
        """The same with an effect that changes the model's structure; its path is brought over."""
        rig = restructured(self.rig, effect, self.channels)
        moved = moved_path(self.rig, rig, effect, self.segments, path)
        scales = moved_situation(self.situation, rig)
        torque = np.full(rig.model.nv, float(np.min(self.torque)))
        for joint in scales.joints:
            torque[joint.v] = joint.torque
        # What has no actuator and no mass of its own is pushed by nobody.
        torque[list(rig.added_dofs)] *= 1e-3
        segments = self.segments.finer(steps_in(self.segments.step, min(effect.fastest, FASTEST)))
        laws = _laws(rig, segments, scales, moved, self.fine)
        return Problem(rig, self.channels, segments, scales, moved, torque, laws, self.threads, self.fine)

    def along(self, path: Array, fine: bool = False) -> "Problem":
        """The same with errors of laws along a path that was fitted, all shapes of them or those that matter.

        Along the recorded path, the force of a stiff servo has the readings' noise in it: errors of its law
        would pass for that noise.
        """
        laws = _laws(self.rig, self.segments, self.situation, path, fine)
        return replace(self, laws=laws, path=path, fine=fine, law_columns_told=None)

    def with_law_error(self, law_error: float) -> "Problem":
        """The same with those columns of errors of laws alone that matter where laws err by so much."""
        return replace(self, law_columns_told=self.law_columns.told_at(law_error))

    def with_steps_for(self, effect: JointEffect) -> "Problem":
        """The same in steps that are as short as an effect's fastest motion needs."""
        return replace(self, segments=self.segments.finer(steps_in(self.segments.step, effect.fastest)))

    def in_steps(self, segments: Segments) -> Segments:
        """Other segments in the time steps of this problem."""
        return segments.finer(self.segments.substeps // segments.substeps)

    @cached_property
    def simulator(self) -> Simulator:
        """Of the rig."""
        return Simulator(self.rig, self.threads)

    @cached_property
    def law_columns(self) -> LawColumns:
        """Errors of the nominal model's laws, in as many shapes as the data tell apart."""
        if self.law_columns_told is not None:
            return self.law_columns_told
        return law_columns(self.simulator, self.segments, self.path, self.torque, self.laws, self.first_noise)

    @cached_property
    def fitter(self) -> Fitter:
        """Of these segments."""
        return Fitter(
            self.simulator, self.segments, self.torque, NUISANCE, self.situation, self.law_columns.W,
            self.drifts(self.segments),
        )  # fmt: skip

    def drifts(self, segments: Segments) -> Array:
        """(S, k) shapes of slow drift, of unit size over the session and with a mean of 0."""
        own = _bumps(self.segments.order)
        size = np.sqrt(np.sum(np.var(own, axis=0)))
        shapes = _bumps(segments.order) - own.mean(axis=0)
        return np.asarray(shapes / size if size > _SAME else shapes[:, :0])

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Quantity of each channel; places of bodies and angles of joints apart."""
        return tuple(o.quantity + (" of joint" if o.dof is not None else "") for o in self.rig.observations)

    @cached_property
    def catalogue(self) -> tuple[JointEffect, ...]:
        """Every effect on every part, and free forms."""
        return (*instances(self.situation), *free_forms(self.situation, self.segments))

    @cached_property
    def first_noise(self) -> Noise:
        """Where the search for noise begins."""
        nv = self.rig.model.nv
        speed = np.full(nv, max([j.speed for j in self.situation.joints] + [self.situation.speed, 1e-3]))
        observed = {observation.dof for observation in self.rig.observations}
        for joint in self.situation.joints:
            if joint.v in observed:  # of others the path says nothing
                speed[joint.v] = joint.speed
        dim = self.simulator.tangent.dim
        first = first_noise(self.segments, self.torque, dim, np.full(nv, POSITION_SPREAD), _TIGHTEN * speed)
        clocks = [self.channels[observation.channel].clock for observation in self.rig.observations]
        first = replace(first, clock=np.unique(clocks, return_inverse=True)[1])
        return first.elsewhere(self.rates(self.segments, self.path))

    def rates(self, segments: Segments, path: Array) -> Array:
        """(S, L, ny) derivatives by time of what is observed along a path."""
        (S, L), u = segments.shape, segments.control()[:, :, :1]
        _, y, _ = self.simulator.run(
            self.rig.model, path.reshape(S * L, -1), u.reshape(S * L, 1, u.shape[-1])
        )
        return segments.rate(y.reshape(S, L, -1))

    def base(self, free: Sequence[JointEffect]) -> Hypothesis:
        """The nominal rig with its free parameters."""
        return Hypothesis(self.rig, tuple(free))


def _bumps(order: Array) -> Array:
    centres = np.arange(-0.5, 0.5 + _DRIFT_WIDTH / 2, _DRIFT_WIDTH)
    return np.asarray(np.exp(-0.5 * ((order[:, None] - centres) / _DRIFT_WIDTH) ** 2))


def _laws(
    rig: Rig, segments: Segments, scales: Situation, path: Array, fine: bool = False
) -> tuple[Sequence[Look], ...]:
    nq, nv = rig.model.nq, rig.model.nv
    following = np.concatenate([path[:, 1:], path[:, -1:]], axis=1)
    there, u = segments.inside, segments.control()
    x = path[there]
    first = actuator_torque(rig.model, x, u[..., 0, :][there], rig.load)
    last = actuator_torque(rig.model, following[there], u[..., -1, :][there], rig.load)
    torque = (first + last) / 2
    order = np.repeat(segments.order[:, None], segments.shape[1], 1)[there]
    state = State(x[:, :nq], x[:, nq : nq + nv], torque, segments.time[there], order)
    return tuple(law_errors(scales, state, fine))


@dataclass(frozen=True)
class Examination:
    """A fitted hypothesis with the scores of everything that it lacks.

    Attributes:
        fit: of the hypothesis.
        system: linear about the path before the last round of the fit.
        noise: of the data, everything that might be there being integrated out.
        left: the same with all the process force that the hypothesis leaves; the fit's.
        scores: own parameters and nuisance eliminated.
        effects: candidates; `columns` says which of the scores' candidates are theirs.
        columns: one index array for each effect.
        looks: one for each candidate column.
        pulses: when something pushes.
    """

    fit: Fit
    system: Linear
    noise: Noise
    left: Noise
    scores: Scores
    effects: tuple[JointEffect, ...]
    columns: tuple[NDArray[np.intp], ...]
    looks: tuple[Look, ...]
    pulses: Scan


def first_look(problem: Problem, hypothesis: Hypothesis) -> tuple[Problem, Fit, Noise]:
    """A hypothesis fitted from the recorded path, all that its laws lack being process force.

    Returns:
        The problem with errors of laws along the fitted path, the fit, and a first guess of the noise.
    """
    path = problem.path
    fitter = Fitter(
        problem.simulator, problem.segments, problem.torque, NUISANCE, problem.situation,
        drifts=problem.drifts(problem.segments),
    )  # fmt: skip
    system, prior = fitter.system(hypothesis, hypothesis.start, path)
    noise = fit_noise(system, prior, problem.first_noise, problem.segments, problem.kinds, last=False)
    fit = fitter.fit(hypothesis, hypothesis.start, path, noise, rounds=8, known=system)
    return problem.along(fit.path), fit, noise


def examine(
    problem: Problem, hypothesis: Hypothesis, theta: Array, path: Array, noise: Noise, *, near: bool = True
) -> Examination:
    """Fit a hypothesis and its noise, and score everything that it lacks.

    Args:
        problem: data.
        hypothesis: what to fit.
        theta: first values.
        path: first path.
        noise: where the search for noise begins.
        near: whether the noise was fitted before, so that one start suffices.
    """
    fitter = problem.fitter
    present = {effect.key for effect in hypothesis.effects}
    effects = tuple(e for e in problem.catalogue if e.initial_values and e.key not in present)
    own = len(hypothesis.parameters)
    fixed = own + len(NUISANCE)
    looks = looks_at(effects)
    system, prior = fitter.system(hypothesis, theta, path, looks)
    candidate = np.zeros(len(prior.sd), bool)
    candidate[fixed : fixed + len(looks)] = True
    many = [look.effect is not None and (look.effect.many_forms or is_free(look.effect)) for look in looks]
    explains = ~candidate
    explains[fixed : fixed + len(looks)] = ~np.array(many, bool)
    noise = fit_noise(
        _with(system, explains), prior.select(explains), noise, problem.segments, problem.kinds, near=near
    )
    own_columns = _with(system, ~candidate), prior.select(~candidate)
    left = fit_process_force(*own_columns, noise, problem.segments.interval)
    fit = fitter.fit(hypothesis, theta, path, left, rounds=8, known=system)
    # About the path before the last fit, which is as good a point: scores eliminate what the fit moved.
    found = innovations(system, noise.covariances(problem.segments.interval))
    fixed_columns = ~candidate
    sd = prior.at(noise)[fixed_columns]
    z = found.Z[..., fixed_columns].reshape(found.e.size, -1) * sd
    values = sd * np.linalg.solve(np.eye(len(sd)) + z.T @ z, z.T @ found.e.reshape(-1))
    pulses = scan(_with(system, fixed_columns), values, noise, problem.segments, problem.situation)
    columns = []
    for effect in effects:
        columns.append(np.array([i for i, look in enumerate(looks) if look.effect is effect]))
    return Examination(
        fit,
        system.without_columns(),
        noise,
        left,
        scores(found, prior.at(noise), fixed_columns),
        effects,
        tuple(columns),
        tuple(looks),
        pulses,
    )


def _with(system: Linear, columns: NDArray[np.bool_]) -> Linear:
    return system.with_columns(
        np.ascontiguousarray(system.W[..., columns]), np.ascontiguousarray(system.psi[..., columns])
    )
