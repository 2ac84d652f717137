"""Whether pushes are events from outside, or come back: in most episodes, or at one place.

An obstacle, a magnet or a cable acts for moments too, but where the robot is, and not at any time.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.selection.steps import P_VALUE, Step
from slapshot.effects.joints.effect import JointEffect
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse
from slapshot.effects.joints.parts import moving_bodies

# Pushes in a larger share of at least this many episodes are not events but systematic.
_MAX_PUSHED_SHARE, _MIN_EPISODES = 0.5, 4
_APART_S = 0.3  # pushes of an episode that are nearer in time are one event
_FEWEST_EVENTS, _DRAWS, _MOST_NODES = 3, 999, 4000
_LEAST_SPREAD_M = 1e-4


def recurring_pushes(step: Step, named: Sequence[JointEffect], rng: np.random.Generator) -> str | None:
    """What says that pushes have a cause that no named effect explains; None where nothing does.

    Args:
        step: the last of a search.
        named: effects, pushes among them.
        rng: for draws of places.
    """
    pulses = [pulse for effect in named if isinstance(effect, ExternalPulse) for pulse in effect.pulses]
    episodes = len(np.unique(step.problem.segments.episode))
    pushed = len({pulse.order for pulse in pulses})
    if episodes >= _MIN_EPISODES and pushed > _MAX_PUSHED_SHARE * episodes:
        return f"pushes come in {pushed} of {episodes} episodes, with a cause that no named effect explains"
    body = _one_place(step, pulses, rng)
    if body is not None:
        return f"pushes come where body {body} is at one place, with a cause that no named effect explains"
    return None


def _one_place(step: Step, pulses: Sequence[Pulse], rng: np.random.Generator) -> str | None:
    """The body that is nearly at one place whenever something pushes; None without one.

    The spread of its places then is compared with that at as many moments drawn at random from all that was
    recorded, for the body for which it is smallest: a Monte Carlo test at the level of a mismatch.
    """
    model, segments = step.problem.rig.model, step.problem.segments
    events = _events(pulses)
    if len(events) < _FEWEST_EVENTS:
        return None
    state = step.scored.fit.trajectory[..., : model.nq]
    nodes = np.argwhere(segments.inside)
    nodes = nodes[np.unique(np.linspace(0, len(nodes) - 1, min(len(nodes), _MOST_NODES)).astype(int))]
    at = np.array([_node_of(event, segments) for event in events])
    bodies = moving_bodies(model)
    there = _spread(_places(model, state[tuple(at.T)], bodies))
    drawn = _places(model, state[tuple(nodes.T)], bodies)
    picks = rng.integers(0, len(drawn), (_DRAWS, len(events)))
    chance = np.array([_spread(drawn[pick]) for pick in picks])
    usual = np.median(chance, axis=0)
    moves = usual > _LEAST_SPREAD_M**2
    if not moves.any():
        return None
    ratio = there[moves] / usual[moves]
    smaller = np.sum((chance[:, moves] / usual[moves]).min(1) <= ratio.min())
    if (1 + smaller) / (1 + _DRAWS) >= P_VALUE:
        return None
    body = int(np.array(bodies)[moves][ratio.argmin()])
    return str(model.body(body).name) or f"number {body}"


def _events(pulses: Sequence[Pulse]) -> list[Pulse]:
    """Pushes of any joints, those next to each other in time once: the first of them."""
    found: list[Pulse] = []
    end = -np.inf
    for pulse in sorted(pulses, key=lambda pulse: (pulse.episode, pulse.begin)):
        if not found or pulse.episode != found[-1].episode or pulse.begin > end + _APART_S:
            found.append(pulse)
            end = pulse.end
        end = max(end, pulse.end)
    return found


def _node_of(pulse: Pulse, segments: Segments) -> tuple[int, int]:
    """Segment and node at the middle of a push."""
    away = np.abs(segments.time - (pulse.begin + pulse.end) / 2)
    away[(segments.ids[segments.episode] != pulse.episode)[:, None] | ~segments.inside] = np.inf
    segment, node = np.unravel_index(away.argmin(), away.shape)
    return int(segment), int(node)


def _places(model: mujoco.MjModel, positions: Array, bodies: Sequence[int]) -> Array:
    """(n, bodies, 3) m, centres of mass at generalised positions (n, nq)."""
    data = mujoco.MjData(model)
    places = np.empty((len(positions), len(bodies), 3))
    for place, position in zip(places, positions, strict=True):
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        place[:] = data.xipos[list(bodies)]
    return places


def _spread(places: Array) -> Array:
    """(bodies,) mean square distance from the mean of places (n, bodies, 3)."""
    return np.asarray(((places - places.mean(0)) ** 2).sum(-1).mean(0))
