"""Time steps that are accurate enough for the data, where those of the given model are not.

MuJoCo's default integrator, and the implicit ones, err in proportion to their step. Within half a second such
an error can be many times the noise of an encoder, and would be called a mismatch of a robot whose physics
the model has. The data say by which steps they came about: of a robot by none, of a simulation by its own.
"""

from dataclasses import replace

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import Linear, innovations
from slapshot.diagnosis.fit.noise import Noise, Prior
from slapshot.diagnosis.fit.shooting import simulate
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.segments import Segments, in_steps_of, steps_between
from slapshot.recordings.channels import Channel
from slapshot.recordings.signals import SignalRecording

_FINER = 8  # steps in one, of a reference
_WINDOW_S = 0.5  # in which errors grow
_NEGLIGIBLE = 0.3  # of the noise: predictions err by 4 % more
_EXACT = 0.1  # of the noise, by which longer steps may err: predictions err by half a per cent more
# Of a longer step: s, since forces of laws are held over it, and steps of the model, since the constraint of
# dry friction stops a joint within one of these (see `add_friction`) and is unstable in 2.8.
_LONGEST_S, _MOST_LONGER = 2.5e-3, 2.0
_SURE_NATS = 3.0  # by which data must prefer the steps of the model: a factor of twenty
_RUNGE_KUTTA = int(mujoco.mjtIntegrator.mjINT_RK4)
_NAMES = {
    int(mujoco.mjtIntegrator.mjINT_EULER): "Euler",
    int(mujoco.mjtIntegrator.mjINT_IMPLICIT): "implicit",
    int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST): "implicitfast",
}


def step_error(
    simulator: Simulator, segments: Segments, trajectory: Array, exact: Segments | None = None
) -> Array:
    """(ny,) rms error of observations by a model's time steps, within half a second; infinite if it diverges.

    Args:
        simulator: of the model.
        segments: whose controls drive it.
        trajectory: (S, L, nx), from whose first states it starts.
        exact: the same in the steps of a reference; None for these in an eighth.
    """
    hypothesis, nodes = Hypothesis(simulator.rig), max(2, round(_WINDOW_S / segments.interval))
    both = [
        simulate(simulator, hypothesis, np.zeros(0), steps, trajectory[:, 0])[1][:, :nodes]
        for steps in (segments, segments.finer(_FINER) if exact is None else exact)
    ]
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.where(segments.inside[:, :nodes, None], both[0] - both[1], 0.0)
        rms = np.sqrt(np.mean(error**2, axis=(0, 1)))
    return np.where(np.isfinite(rms), rms, np.inf)


def with_accurate_steps(
    rig: Rig,
    channels: dict[str, Channel],
    recording: SignalRecording,
    segments: Segments,
    trajectory: Array,
    noise: Array,
) -> tuple[Rig, str] | None:
    """The rig with Runge and Kutta's integrator, and what is said of it; None where its own will do.

    Args:
        rig: as it was given.
        channels: that are used of what was recorded.
        recording: with all of them.
        segments: of the recording.
        trajectory: (S, L, nx) recorded.
        noise: (ny,) standard deviation of a reading.
    """
    given = int(rig.model.opt.integrator)
    if given not in _NAMES or not len(noise):
        return None
    error = step_error(Simulator(rig), segments, trajectory) / noise
    worst = int(np.argmax(error))
    if not _NEGLIGIBLE <= error[worst] < np.inf:  # a model that diverges is no matter of its steps
        return None
    spec = rig.spec.copy()
    spec.option.integrator = _RUNGE_KUTTA
    better = bind(spec, channels, rig.name, rig.free)
    better = replace(better, controls=rig.controls, given_integrator=given)
    if not np.max(step_error(Simulator(better), segments, trajectory) / noise) < error[worst] / 2:
        return None
    # A step takes four times as long as one of the model's.
    fewer = steps_between(segments.interval, min(_LONGEST_S, _MOST_LONGER * rig.model.opt.timestep))
    if fewer < segments.substeps:
        longer = replace(better, longest_step=segments.interval / fewer)
        coarse = in_steps_of(longer, recording, segments)
        error_of_longer = step_error(Simulator(longer), coarse, trajectory, segments.finer(_FINER))
        if np.max(error_of_longer / noise) < _EXACT:
            better = longer
    name, channel = _NAMES[given], rig.observations[worst].channel
    step = better.longest_step or segments.step
    return better, (
        f"in steps of {1e3 * segments.step:.3g} ms the model's integrator ({name}) errs within half a second "
        f"by {error[worst]:.2g} times the noise of {channel}; here Runge-Kutta steps (RK4) of "
        f"{1e3 * step:.3g} ms simulate it"
    )


def prefers_its_steps(system: Linear, prior: Prior, noise: Noise, interval: float, column: int) -> bool:
    """Whether data were surely made by the steps of the model, as by a simulation, and not by accurate ones.

    By the likelihood of none of the error of the steps against that of all of it, whatever else is missing.

    Args:
        system: of the model with its own steps, with columns of all that may be missing.
        prior: of its columns.
        noise: about it.
        interval: s between nodes.
        column: of the error of the steps, which one standard deviation of its prior removes.
    """
    seen = innovations(system, noise.covariances(interval))
    z = seen.Z.reshape(seen.e.size, -1) * prior.at(noise)
    own, rest = z[:, column], np.delete(z, column, axis=1)
    both = np.column_stack([own, seen.e.reshape(-1)])
    taken = np.linalg.solve(np.eye(rest.shape[1]) + rest.T @ rest, rest.T @ both)
    information, score = own @ both - (own @ rest) @ taken
    return bool(score - 0.5 * information < -_SURE_NATS)
