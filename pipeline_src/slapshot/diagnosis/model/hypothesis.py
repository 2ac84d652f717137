"""A hypothesis: the nominal model with some effects, and how it is simulated from many states at once."""

import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.model.tangent import Tangent
from slapshot.effects.joints.effect import JointEffect, Observed, Parameter, State, overrides

# In the order in which MuJoCo has them.
_CONTROL = sum(
    part.value
    for part in (
        mujoco.mjtState.mjSTATE_CTRL,
        mujoco.mjtState.mjSTATE_QFRC_APPLIED,
        mujoco.mjtState.mjSTATE_MOCAP_POS,
        mujoco.mjtState.mjSTATE_MOCAP_QUAT,
    )
)
_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
_CONSTRAINTS = "jnt_limited", "dof_frictionloss", "tendon_limited", "tendon_frictionloss"
_JOINTPOS, _JOINTVEL = int(mujoco.mjtSensor.mjSENS_JOINTPOS), int(mujoco.mjtSensor.mjSENS_JOINTVEL)
_GAINS = (int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE))
_BIASES = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))


@dataclass(frozen=True)
class Hypothesis:
    """Effects in a rig; their values form one vector, in order.

    Attributes:
        rig: nominal, or restructured by effects with states of their own.
        effects: present.
    """

    rig: Rig
    effects: tuple[JointEffect, ...] = ()

    @cached_property
    def tangent(self) -> Tangent:
        """Of the rig's states."""
        return Tangent(self.rig.model)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Of all effects."""
        return tuple(parameter for effect in self.effects for parameter in effect.parameters)

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Slice of each effect's values."""
        ends = np.cumsum([len(effect.parameters) for effect in self.effects])
        return tuple(
            slice(int(end) - len(effect.parameters), int(end))
            for effect, end in zip(self.effects, ends, strict=True)
        )

    @property
    def added(self) -> tuple[JointEffect, ...]:
        """Those that are no free parameters of the nominal model."""
        free = set(self.rig.free)
        return tuple(e for e in self.effects if not free & {e.name, e.key, f"{e.name}@{e.part}"})

    @cached_property
    def start(self) -> Array:
        """Values at which fits begin."""
        return np.array([parameter.start for parameter in self.parameters])

    @cached_property
    def prior_sd(self) -> Array:
        """Standard deviations of the priors."""
        return np.array([parameter.scale for parameter in self.parameters])

    def clipped(self, theta: Array) -> Array:
        """Values clipped to their bounds."""
        low = np.array([parameter.low for parameter in self.parameters])
        high = np.array([parameter.high for parameter in self.parameters])
        return np.clip(theta, low, high)

    def with_effect(self, effect: JointEffect) -> "Hypothesis":
        """The hypothesis with one more effect."""
        return Hypothesis(self.rig, (*self.effects, effect))

    def compiled(self, theta: Array, step: float) -> mujoco.MjModel:
        """The compiled model with all edits, at a time step in s."""
        model = copy.copy(self.rig.model)
        edited = False
        for effect, part in zip(self.effects, self.slices, strict=True):
            if overrides(effect, "edit"):
                effect.edit(model, theta[part])
                edited = True
        # After the edits, which must not depend on the step.
        model.opt.timestep = step
        if not self.rig.collides:
            # Looking for contacts is a fifth of a step; for constraints where there are none, another tenth.
            free = not (model.neq or any(getattr(model, name).any() for name in _CONSTRAINTS))
            bits = mujoco.mjtDisableBit
            off = bits.mjDSBL_CONSTRAINT if free else bits.mjDSBL_CONTACT
            # And another tenth for finding islands of constraints.
            model.opt.disableflags |= int(off) | int(bits.mjDSBL_ISLAND)
        if edited:
            mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def control(self, segments: Segments, theta: Array) -> Array:
        """Controls with their effects, (S, L, substeps, nu)."""
        acting = [
            (e, part) for e, part in zip(self.effects, self.slices, strict=True) if overrides(e, "control")
        ]
        if not acting:
            return segments.control()

        def edit(u: Array, step: float) -> Array:
            for effect, part in acting:
                u = effect.control(u, step, theta[part])
            return u

        return segments.control(edit)

    def force(self, state: State, theta: Array) -> Array | None:
        """Sum of all generalised forces, (n, nv); None where no effect has any."""
        total: Array | None = None
        for effect, part in zip(self.effects, self.slices, strict=True):
            if overrides(effect, "force"):
                force = effect.force(state, theta[part])
                if force is not None:
                    total = force if total is None else total + force
        return total

    def observe(self, seen: Observed, theta: Array) -> Array:
        """Contribution of all effects to the observations, (n, ny)."""
        total = np.zeros_like(seen.y)
        for effect, part in zip(self.effects, self.slices, strict=True):
            if overrides(effect, "observe"):
                added = effect.observe(seen, theta[part])
                if added is not None:
                    total = total + added
        return total

    @cached_property
    def has_force(self) -> bool:
        """Whether an effect is a force law."""
        return any(overrides(effect, "force") for effect in self.effects)


class Simulator:
    """One interval of a model from n states at once.

    Args:
        rig: whose sensors are read.
        threads: for simulation.
    """

    def __init__(self, rig: Rig, threads: int = 1) -> None:
        self.rig = rig
        self.tangent = Tangent(rig.model)
        self._data = [mujoco.MjData(rig.model) for _ in range(threads)]
        self._loads = rig.load
        self.kept: list[Any] = []  # see `OperatingPoint.at`

    def run(
        self,
        model: mujoco.MjModel,
        x: Array,
        u: Array,
        force: Array | None = None,
    ) -> tuple[Array, Array, Array]:
        """Steps of the model under controls and held forces.

        Args:
            model: of the rig's sizes.
            x: (n, nq + nv + na).
            u: (n, steps, nu), for the inputs of the rig's controls.
            force: (n, nv) generalised force; None for none.

        Returns:
            (n, nq + nv + na) next states, and of the first states (n, ny) observations and (n, nv) actuator
            forces.
        """
        n = len(u)
        initial = np.zeros((n, mujoco.mj_stateSize(model, _STATE)))
        initial[:, 1 : 1 + x.shape[1]] = x
        control = _inputs(model, u, force)
        state, sensed = rollout.rollout(
            model, self._data, initial, control, control_spec=_CONTROL, skip_checks=False
        )
        first = sensed[:, 0]
        torque = np.where(self._loads >= 0, first[:, np.maximum(self._loads, 0)], 0.0)
        return state[:, -1, 1 : 1 + x.shape[1]].copy(), first @ self.rig.reading.T, torque

    def read(self, delta: Array) -> Array:
        """Effect of a change of state, (2 nv + na,), on observed joint positions and velocities."""
        model, sensed = self.rig.model, np.zeros(self.rig.model.nsensordata)
        for sensor in range(model.nsensor):
            at = {_JOINTPOS: 0, _JOINTVEL: model.nv}.get(int(model.sensor_type[sensor]))
            if at is not None:
                sensed[model.sensor_adr[sensor]] = delta[at + model.jnt_dofadr[model.sensor_objid[sensor]]]
        return np.asarray(self.rig.reading @ sensed)

    def trajectory(self, model: mujoco.MjModel, x: Array, u: Array) -> tuple[Array, Array]:
        """Whole trajectories without force laws.

        Args:
            model: of the rig's sizes.
            x: (n, nq + nv + na) first states.
            u: (n, nodes, substeps, nu).

        Returns:
            (n, nodes, nq + nv + na) states and (n, nodes, ny) observations of them.
        """
        n, nodes, substeps, nu = u.shape
        initial = np.zeros((n, mujoco.mj_stateSize(model, _STATE)))
        initial[:, 1 : 1 + x.shape[1]] = x
        control = _inputs(model, u.reshape(n, nodes * substeps, nu))
        state, sensed = rollout.rollout(model, self._data, initial, control, control_spec=_CONTROL)
        # A state of the result stands at the end of its step, a reading at its beginning.
        after = state[:, substeps - 1 :: substeps, 1 : 1 + x.shape[1]]
        states = np.concatenate([x[:, None], after[:, :-1]], axis=1)
        return states, sensed[:, ::substeps] @ self.rig.reading.T

    def advance(
        self,
        hypothesis: Hypothesis,
        theta: Array,
        model: mujoco.MjModel,
        x: Array,
        u: Array,
        time: Array,
        order: Array,
        extra: Array | None = None,
    ) -> tuple[Array, Array, Array]:
        """One interval with the force laws of a hypothesis, evaluated in every step.

        Args:
            hypothesis: whose forces act.
            theta: values.
            model: compiled with them.
            x: (n, nq + nv + na).
            u: (n, steps, nu).
            time: (n,) s from the episode's start.
            order: (n,) place in the session.
            extra: (n, nv) further force, held over the interval.

        Returns:
            As `run`.
        """
        if not hypothesis.has_force:
            return self.run(model, x, u, extra)
        nq, nv = self.tangent.nq, self.tangent.nv
        observed = torque = None
        for step in range(u.shape[1]):
            now = u[:, step : step + 1]
            load = self._torque(model, x, now)
            state = State(x[:, :nq], x[:, nq : nq + nv], load, time + step * model.opt.timestep, order)
            force = hypothesis.force(state, theta)
            if extra is not None:
                force = extra if force is None else force + extra
            x, y, _ = self.run(model, x, now, force)
            if observed is None:
                observed, torque = y, load
        assert observed is not None
        assert torque is not None
        return x, observed, torque

    def _torque(self, model: mujoco.MjModel, x: Array, u: Array) -> Array:
        """Actuator forces at states; of stateless linear actuators on joints without a simulation."""
        return actuator_torque(model, x, u[:, 0], self._loads)


def _inputs(model: mujoco.MjModel, u: Array, force: Array | None = None) -> Array:
    """What MuJoCo is given in every step, (n, steps, ...), with a force (n, nv) that is held."""
    held = np.zeros((*u.shape[:2], model.nv))
    if force is not None:
        held[:] = force[:, None]
    return np.concatenate([u[..., : model.nu], held, u[..., model.nu :]], axis=-1)


def actuator_torque(model: mujoco.MjModel, x: Array, u: Array, loads: NDArray[np.intp]) -> Array:
    """Torque of actuators on each hinge and slide, by their affine laws, (n, nv).

    Actuators with other transmissions or laws are ignored.
    """
    torque, force = np.zeros((len(x), model.nv)), actuator_force(model, x, u)
    for i in range(model.nu):
        v = _driven(model, i)
        if v is not None and loads[v] >= 0:
            torque[:, v] += model.actuator_gear[i, 0] * force[:, i]
    for j in np.flatnonzero(model.jnt_actfrclimited):
        v = int(model.jnt_dofadr[j])
        torque[:, v] = np.clip(torque[:, v], *model.jnt_actfrcrange[j])
    return torque


def actuator_force(model: mujoco.MjModel, x: Array, u: Array) -> Array:
    """Force of actuators of hinges and slides, before their gears, (n, nu); 0 of others."""
    forces = np.zeros((len(x), model.nu))
    for i in range(model.nu):
        v = _driven(model, i)
        if v is None:
            continue
        gear = model.actuator_gear[i, 0]
        drive = u[:, i]
        if model.actuator_ctrllimited[i]:
            drive = np.clip(drive, *model.actuator_ctrlrange[i])
        if model.actuator_actnum[i] > 0:
            last = model.actuator_actadr[i] + model.actuator_actnum[i] - 1
            drive = x[:, model.nq + model.nv + last]
        length = gear * x[:, model.jnt_qposadr[model.actuator_trnid[i, 0]]]
        rate = gear * x[:, model.nq + v]
        gain, bias = model.actuator_gainprm[i], model.actuator_biasprm[i]
        force = gain[0] * drive
        if model.actuator_gaintype[i] == int(mujoco.mjtGain.mjGAIN_AFFINE):
            force = (gain[0] + gain[1] * length + gain[2] * rate) * drive
        if model.actuator_biastype[i] == int(mujoco.mjtBias.mjBIAS_AFFINE):
            force = force + bias[0] + bias[1] * length + bias[2] * rate
        if model.actuator_forcelimited[i]:
            force = np.clip(force, *model.actuator_forcerange[i])
        forces[:, i] = force
    return forces


def _driven(model: mujoco.MjModel, actuator: int) -> int | None:
    """The dof of the hinge or slide that an actuator drives; None for other transmissions and laws."""
    joint = int(model.actuator_trnid[actuator, 0])
    if model.actuator_trntype[actuator] != int(mujoco.mjtTrn.mjTRN_JOINT):
        return None
    if model.actuator_gaintype[actuator] not in _GAINS or model.actuator_biastype[actuator] not in _BIASES:
        return None
    scalar = model.jnt_type[joint] in (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return int(model.jnt_dofadr[joint]) if scalar else None
