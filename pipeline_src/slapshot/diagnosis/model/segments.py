"""Recorded signals on a regular grid of nodes, divided into segments.

Nodes lie one interval apart. A sample between two nodes is assigned to the nearer one (its offset in time is
kept in `shift` and corrected along the trajectory), so that clocks need neither be synchronous nor regular.
Between nodes the model takes `substeps` steps; each has the mean of the controls over its time.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.model.rig import Control, Rig
from slapshot.errors import InputError
from slapshot.recordings.signal_quality import clock_sampling
from slapshot.recordings.signal_statistics import channel_statistics
from slapshot.recordings.signals import SignalRecording

# Several faster samples are averaged to a node: mechanics are slower, and every node costs time.
LONGEST_AVERAGE_S = 5e-3
SEGMENT_S = 0.5
# From which episodes are blocks of data by themselves, and blocks of a recording with fewer.
_EPISODES, _BLOCKS = 8, 10
# Scatter of the intervals of controls, in median ones, above which stamps err, and above which they are
# written when they change.
_REGULAR, _UNEVEN = 1e-3, 0.5


@dataclass(frozen=True)
class ControlSignal:
    """The control signal of one input in one episode.

    Attributes:
        t: (n,) s, of the samples.
        value: (n,)
        linear: interpolated between samples; else each holds until the next.
    """

    t: Array
    value: Array
    linear: bool

    def means(self, edges: Array) -> Array:
        """Means over the times between edges; before the first sample and after the last they hold.

        Args:
            edges: (m + 1,) s, increasing.

        Returns:
            (m,)
        """
        width = np.diff(edges)
        if self.linear:
            knots = np.union1d(self.t, edges)
            values = np.interp(knots, self.t, self.value)
            integral = np.concatenate([[0.0], np.cumsum(np.diff(knots) * (values[1:] + values[:-1]) / 2)])
            return np.diff(np.interp(edges, knots, integral)) / width
        # The integral of a step function, with its first value before the first sample.
        first = min(self.t[0], edges[0]) - 1.0
        last = max(self.t[-1], edges[-1]) + 1.0
        knots = np.concatenate([[first], self.t[1:], [last]])
        integral = np.concatenate([[0.0], np.cumsum(np.diff(knots) * self.value)])
        return np.diff(np.interp(edges, knots, integral)) / width


ControlEdit = Callable[[Array, float], Array]
# Of each clock, each episode's samples.
_Samples = Mapping[str, Mapping[int, pd.DataFrame]]


@dataclass(frozen=True)
class Segments:
    """Data of S segments of L nodes; ny channels, nu inputs.

    Attributes:
        interval: s between nodes.
        substeps: steps of the model in an interval.
        y: (S, L, ny) recorded; NaN where nothing was.
        shift: (S, L, ny) s from the node to the sample, or to the mean of several.
        shift_square: (S, L, ny) s², mean square of the same.
        inside: (S, L) whether the node belongs to the episode; others are padding.
        time: (S, L) s from the episode's start.
        episode: (S,) index of the episode.
        first: (S,) node of the episode at which the segment begins.
        order: (S,) place of the episode in the session, from -1/2 to 1/2.
        controls: one (nodes * substeps, nu) array for each episode: means over model steps.
        ids: identifiers of the episodes, as recorded.
        quantisation: (ny,) step of each channel's samples; 0 where they have none.
        stamp_error: (nu,) s by which stamps of controls may err: the change of an input from node to node,
            times this, is the sd of its integral over an interval. None where stamps are regular.
    """

    interval: float
    substeps: int
    y: Array
    shift: Array
    shift_square: Array
    inside: NDArray[np.bool_]
    time: Array
    episode: NDArray[np.intp]
    first: NDArray[np.intp]
    order: Array
    controls: tuple[Array, ...]
    ids: NDArray[np.int64]
    quantisation: Array
    stamp_error: Array | None = None

    @property
    def step(self) -> float:
        """Time step of the model in s."""
        return self.interval / self.substeps

    @property
    def shape(self) -> tuple[int, int]:
        """S, L."""
        return self.y.shape[0], self.y.shape[1]

    def runs(self) -> list[NDArray[np.intp]]:
        """Runs of consecutive segments, in order of time."""
        order = np.lexsort([self.first, self.episode])
        follows = np.diff(self.episode[order]) == 0
        follows &= np.diff(self.first[order]) == self.shape[1]
        return np.split(order, np.flatnonzero(~follows) + 1)

    def blocks(self) -> NDArray[np.intp]:
        """(S,) episode of each segment, or which tenth of the recording where there are few episodes."""
        _, of = np.unique(self.episode, return_inverse=True)
        if of.max(initial=0) + 1 >= _EPISODES:
            return np.asarray(of)
        S = len(self.episode)
        place = np.empty(S, np.intp)
        place[np.lexsort([self.first, self.episode])] = np.arange(S)
        return np.asarray(place * min(_BLOCKS, S) // max(S, 1))

    def rate(self, values: Array) -> Array:
        """Time derivative of values at the nodes, second order, from inside nodes only.

        Args:
            values: (S, L, ...).

        Returns:
            (S, L, ...), 0 beyond the end of an episode.
        """
        out = np.zeros_like(values)
        for length in np.unique(self.inside.sum(axis=1)):
            if length > 1:
                own = self.inside.sum(axis=1) == length
                out[own, :length] = np.gradient(
                    values[own, :length], self.interval, axis=1, edge_order=2 if length > 2 else 1
                )
        return out

    def select(self, some: NDArray[np.bool_] | NDArray[np.intp]) -> "Segments":
        """Some of the segments; controls stay whole."""
        kept = ("y", "shift", "shift_square", "inside", "time", "episode", "first", "order")
        return replace(self, **{name: getattr(self, name)[some] for name in kept})

    def later(self, node: int) -> "Segments":
        """The same from a node on."""
        cut = {
            name: getattr(self, name)[:, node:] for name in ("y", "shift", "shift_square", "inside", "time")
        }
        return replace(self, **cut, first=self.first + node)

    def finer(self, steps: int) -> "Segments":
        """The same with each model step in several."""
        if steps == 1:
            return self
        controls = tuple(np.repeat(u, steps, axis=0) for u in self.controls)
        return replace(self, substeps=self.substeps * steps, controls=controls)

    def control(self, edit: ControlEdit | None = None) -> Array:
        """Controls of every model step, (S, L, substeps, nu).

        Args:
            edit: changes the controls of a whole episode, (steps, nu) at a time step in s.
        """
        (S, L), n = self.shape, self.substeps
        whole = [u if edit is None else edit(u, self.step) for u in self.controls]
        out = np.empty((S, L, n, whole[0].shape[1]))
        for k in range(S):
            u = whole[self.episode[k]]
            part = u[self.first[k] * n : (self.first[k] + L) * n]
            steps = np.minimum(np.arange(L * n), len(part) - 1)
            out[k] = part[steps].reshape(L, n, -1)
        return out


def node_interval(recording: SignalRecording, rig: Rig) -> float:
    """Time in s between nodes: one or several median intervals of the fastest clock that observes."""
    clocks = {recording.channels[o.channel].clock for o in rig.observations}
    intervals = []
    for clock in clocks:
        table = recording.signals[clock]
        gaps = table.groupby("episode")["t"].diff().dropna()
        if len(gaps):
            intervals.append(float(gaps.median()))
    if not intervals:
        raise InputError("signals: no episode has two samples; record motions")
    fastest = min(intervals)
    return fastest * max(1, int(LONGEST_AVERAGE_S / fastest + 0.01))


def segment_recording(
    recording: SignalRecording,
    rig: Rig,
    *,
    segment_s: float = SEGMENT_S,
    finer: int = 1,
    nodes: int | None = None,
    parts: Sequence[tuple[int, int, int]] | None = None,
) -> Segments:
    """Resample a recording to a grid and divide it into segments.

    Args:
        recording: of the rig's channels.
        rig: what they are.
        segment_s: length of a segment in s.
        finer: factor by which model steps are shorter than the model's own.
        nodes: of a segment, in place of its length in s.
        parts: what is divided: index of an episode in the session, first node and number of nodes; None for
            whole episodes.

    Raises:
        InputError: an episode has no observation.
    """
    interval = node_interval(recording, rig)
    substeps = steps_between(interval, rig.longest_step or rig.model.opt.timestep) * finer
    L = max(4, round(segment_s / interval)) if nodes is None else nodes
    episodes = recording.episodes.sort_values("order")
    count = len(episodes)
    orders = np.linspace(-0.5, 0.5, count) if count > 1 else np.zeros(1)
    y, shift, square, inside, time, owner, first, order = [], [], [], [], [], [], [], []
    controls, ids = [], []
    # Once for all episodes, of which there may be thousands.
    samples: _Samples = {
        clock: {int(own["episode"].iloc[0]): own for _, own in table.groupby("episode")}
        for clock, table in recording.signals.items()
    }
    for index, episode in enumerate(episodes["episode"]):
        t, values, offset, offset_square = _on_grid(recording, samples, rig, int(episode), interval)
        edges = t[0] + np.arange(len(t) * substeps + 1) * (interval / substeps)
        controls.append(
            np.stack(
                [_followed(recording, samples, c, int(episode)).means(edges) * c.factor for c in rig.controls]
                or [np.zeros(len(edges) - 1)],
                axis=1,
            )[:, : len(rig.controls)]
        )
        ids.append(int(episode))
        own = [(0, len(t))] if parts is None else [(a, n) for e, a, n in parts if e == index]
        for start, length in (piece for a, n in own for piece in _pieces(a, n, L)):
            if not np.isfinite(values[start : start + length]).any():
                continue  # nothing says what happened, however long it took
            pad, there = ((0, L - length), (0, 0)), slice(start, start + length)
            y.append(np.pad(values[there], pad, constant_values=np.nan))
            shift.append(np.pad(offset[there], pad))
            square.append(np.pad(offset_square[there], pad))
            inside.append(np.arange(L) < length)
            time.append(t[start] + np.arange(L) * interval)
            owner.append(index)
            first.append(start)
            order.append(orders[index])
    return Segments(
        interval, substeps, np.array(y), np.array(shift), np.array(square), np.array(inside),
        np.array(time), np.array(owner), np.array(first), np.array(order), tuple(controls),
        np.array(ids, np.int64),
        np.array([channel_statistics(recording, o.channel).grid for o in rig.observations]),
        _stamp_error(recording, rig, interval),
    )  # fmt: skip


def steps_between(interval: float, longest: float) -> int:
    """How many time steps are taken between nodes, where none is longer than so many s."""
    return max(1, int(np.ceil(interval / longest - 1e-6)))


def in_steps_of(rig: Rig, recording: SignalRecording, segments: Segments) -> Segments:
    """Segments of a recording in another rig's time steps."""
    whole = segment_recording(recording, rig)
    return replace(segments, substeps=whole.substeps, controls=whole.controls)


def _stamp_error(recording: SignalRecording, rig: Rig, interval: float) -> Array | None:
    """See `Segments`; from how the intervals of a clock of controls scatter that is meant to be regular."""
    clocks = {c.channel: recording.channels[c.channel].clock for c in rig.controls if c.channel is not None}
    sampled = {clock: clock_sampling(recording, clock) for clock in set(clocks.values())}
    error = np.zeros(len(rig.controls))
    for k, control in enumerate(rig.controls):
        if control.channel is not None:
            found = sampled[clocks[control.channel]]
            if _REGULAR < found.jitter < _UNEVEN:
                # Of several changes in an interval each errs by itself.
                changes = max(1.0, interval / found.interval_s)
                error[k] = found.jitter * found.interval_s / np.sqrt(2 * changes)
    return error if error.any() else None


def _pieces(first: int, count: int, length: int) -> Iterator[tuple[int, int]]:
    """First node and number of nodes of the pieces of a part; a few samples cannot determine a state."""
    for start in range(first, first + count, length):
        nodes = min(length, first + count - start)
        if start == first or nodes >= length // 4:
            yield start, nodes


def _of_episode(
    recording: SignalRecording, samples: _Samples, channel: str, episode: int
) -> tuple[Array, Array]:
    """Times and values of a channel's samples in an episode, those that were lost left out."""
    own = samples[recording.channels[channel].clock].get(episode)
    if own is None:
        return np.zeros(0), np.zeros(0)
    t, value = own["t"].to_numpy(float), own[channel].to_numpy(float)
    there = np.isfinite(value)
    return t[there], value[there]


def _on_grid(
    recording: SignalRecording, given: _Samples, rig: Rig, episode: int, interval: float
) -> tuple[Array, Array, Array, Array]:
    """Times of an episode's nodes, the mean of the samples nearest to each, and moments of their offset.

    The moments are mean and mean square of the offset in time. Values of nodes without a sample are NaN.
    """
    samples = [_of_episode(recording, given, o.channel, episode) for o in rig.observations]
    begin = min((t[0] for t, _ in samples if len(t)), default=None)
    if begin is None:
        raise InputError(f"episode {episode}: nothing was observed; leave the episode out")
    end = max(t[-1] for t, _ in samples if len(t))
    nodes = int(np.floor((end - begin) / interval + 0.5)) + 1
    grid = begin + np.arange(nodes) * interval
    turns = {c for columns in rig.quaternions for c in columns}
    means = np.zeros((3, nodes, len(samples)))
    for c, (t, value) in enumerate(samples):
        nearest = np.clip(np.rint((t - begin) / interval).astype(int), 0, nodes - 1)
        late = t - grid[nearest]
        if c in turns:  # which must not be averaged, as q and -q are the same
            order = np.lexsort([np.abs(late), nearest])
            keep = order[np.diff(nearest[order], prepend=-1) > 0]
            nearest, late, value = nearest[keep], late[keep], value[keep]
        count = np.bincount(nearest, minlength=nodes)
        for mean, weight in zip(means, (value, late, late**2), strict=True):
            mean[:, c] = np.bincount(nearest, weight, nodes) / np.maximum(count, 1)
        means[0, count == 0, c] = np.nan
    return grid, *means


def _followed(recording: SignalRecording, samples: _Samples, control: Control, episode: int) -> ControlSignal:
    channel = control.channel
    if channel is None:
        return ControlSignal(np.zeros(1), np.array([control.rest]), False)
    t, value = _of_episode(recording, samples, channel, episode)
    if not len(t):
        raise InputError(f"episode {episode}: channel {channel} has no value; leave the episode out")
    return ControlSignal(t, value, recording.channels[channel].hold == "linear")
