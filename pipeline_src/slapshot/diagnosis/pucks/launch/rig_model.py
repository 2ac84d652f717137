"""The launch model of a recording whose commands are known: one simulation of all hits, and signatures."""

from collections.abc import Mapping, Sequence
from copy import copy
from functools import partial

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.launch.approach import Approaches
from slapshot.diagnosis.pucks.launch.contact_features import approach_of
from slapshot.diagnosis.pucks.launch.execution import Execution, Readings, readings_of, replay
from slapshot.diagnosis.pucks.launch.launch_model import LaunchModel, LocalChange
from slapshot.diagnosis.pucks.launch.signatures import LOOK, Signatures, digest_of, make_signatures
from slapshot.diagnosis.pucks.launch.strikes import Commands, Striker, commands_of
from slapshot.diagnosis.pucks.launch.swing_error import LATENESS, lateness_of
from slapshot.diagnosis.pucks.selection.free_form import NominalLaunches, contact_features, launch_features
from slapshot.diagnosis.pucks.slide.camera_view import start_shift
from slapshot.diagnosis.pucks.slide.slide_model import Values
from slapshot.diagnosis.pucks.slide.tracks import HitTracks
from slapshot.effects.effect import Effect, Parameter
from slapshot.errors import InputError
from slapshot.recordings.format import Recording, joint_columns
from slapshot.scenes.scene import Scene

LOCAL_STEP = 1.0  # of a parameter's scale, to either side: less is lost in the scatter of contact
ROWS_A_FEATURE = 3  # hits for each feature that a change of launches is smoothed by


class RigModel:
    """What the nominal scene makes of a recording's hits."""

    def __init__(
        self,
        recording: Recording,
        tracks: HitTracks,
        scene: Scene,
        effects: Mapping[str, Effect],
        camera: Array,
        friction: Array,
        signatures: Signatures | None,
        threads: int,
    ) -> None:
        """Simulate once.

        Args:
            recording: with commands, and encoders or not.
            tracks: of its hits; where nobody saw a release, it is looked at LOOK after the contact.
            scene: nominal.
            effects: that may act.
            camera: (2,) m, point of the plane that the camera looks at.
            friction: (objects, 3) as fitted to the slides.
            signatures: of a pool that holds the commands; None, or one that lacks some command or effect, has
                them made.
            threads: for simulations.
        """
        self._tracks, self._effects, self._camera = tracks, effects, camera
        _check_joints(recording, len(scene.info.joints))
        period = scene.info.control_period
        seen_last = float(tracks.release.max(initial=0.0, where=~np.isnan(tracks.release)))
        latest = max(seen_last, _longest(recording)) + 2 * LOOK
        commands = commands_of(recording, tracks, scene, latest)
        # To a length of its own, so that digests do not depend on when objects were released.
        whole = commands_of(recording, tracks, scene, _longest(recording) + 2 * LOOK)
        simulated = {n: e for n, e in effects.items() if n != LATENESS}
        self.signatures, self._rows = _signatures(scene, whole, simulated, signatures, threads)
        unseen = self.signatures.contact[self._rows] + LOOK
        self._release = np.where(np.isnan(tracks.release), unseen, tracks.release)
        self._starts_seen = ~np.isnan(tracks.seen_start[:, 0])
        self._starts = np.where(self._starts_seen[:, None], tracks.seen_start, tracks.start)
        mass = np.array([recording.objects[tracks.objects[k]].mass_kg for k in tracks.object])
        times, joints = np.zeros(1), None
        if recording.joints is not None:
            times, joints = readings_of(
                recording.joints, tracks.hit, period, float(self.signatures.times[-1])
            )
        self._commands, self._times, self._joints = commands, times, joints
        self._friction = friction[tracks.object]
        hits, approaches = (self._release, mass, self._friction), Approaches()
        self._striker = lambda executed, times: Striker(scene, executed, *hits, times, threads, approaches)
        self._servo_time = scene.info.servo_time
        contact = self.signatures.contact[self._rows]
        angles, speeds, _ = self.signatures.swing_at(self._rows, contact)
        self._approach = approach_of(scene, angles, speeds, self._starts)
        self._base: Mapping[str, Values] = {}
        # Effect -> where changes about it were simulated, and those; nearby they are the same. Hypotheses in
        # turn come back to where others were.
        self._local: dict[str, list[tuple[Mapping[str, float], dict[str, LocalChange]]]] = {}
        self._simulate()

    def about(self, effects: Mapping[str, Values]) -> "RigModel":
        """The same hits simulated with effects of swing, contact and camera; linear about those."""
        acting = {
            n: v
            for n, v in effects.items()
            if self._effects[n].acts_on_launch or self._effects[n].acts_on_camera
        }
        if acting == self._base:
            return self
        other = copy(self)
        other._base = acting
        other._simulate()
        return other

    def _simulate(self) -> None:
        acting = [(self._effects[name], values) for name, values in self._base.items()]
        # Where objects lay, not where the camera saw them.
        starts = self._starts.copy()
        for effect, values in acting:
            shift = start_shift(effect, values, self._starts, self._camera)
            starts += np.where(self._starts_seen[:, None], shift, 0.0)
        self._readings: Readings | None = None
        if self._joints is None:
            self._strike = partial(self._striker(self._commands, self._times).strike, starts)
            self._struck = self._strike(acting)
            return
        times, period = self._times, self._commands.period
        swing, speeds = self.signatures.swing(self._rows, times, self._base)
        if LATENESS in self._base:
            swing = swing - lateness_of(self._base[LATENESS], swing.shape[-1]) * speeds
        execution = Execution(times, self._joints - swing, speeds)
        replayed, _ = execution.coefficients(execution.residual)
        # As the hits were executed, not as they were commanded: launches are not linear in the difference.
        positions = replay(self._commands.positions, period, float(times[-1]), replayed)
        rates = np.gradient(positions, period, axis=1)
        executed = Commands(positions, positions + self._servo_time * rates, period)
        # For changes of launches alone, which need no readings.
        self._strike = partial(self._striker(executed, times[:1]).strike, starts)
        self._struck = self._striker(executed, times).strike(starts, acting)
        self._readings = Readings(times, self._joints, self._struck.joints, replayed)

    def _local_changes(self) -> dict[str, LocalChange]:
        """How launches change about the effects they were simulated with, where one has several parameters.

        What each of those does depends on the others, which signatures, made one by one, do not know.
        """
        found: dict[str, LocalChange] = {}
        for owner, values in self._base.items():
            parameters = self._effects[owner].parameters
            mine = [p for p in parameters if f"{owner}/{p.name}" in self.signatures.values]
            if len(mine) < 2:
                continue
            known = self._local.setdefault(owner, [])
            away, changes = min(
                ((_steps_away(values, at, mine), changes) for at, changes in known),
                key=lambda one: one[0],
                default=(np.inf, {}),
            )
            if away > LOCAL_STEP:
                changes = {p.name: self._local_change(owner, p) for p in mine}
                known.append((values, changes))
            found |= {f"{owner}/{name}": changes[name].about(values[name]) for name in changes}
        return found

    def _local_change(self, owner: str, parameter: Parameter) -> LocalChange:
        """By a central difference where bounds leave room: launches bend over a scale of a parameter."""
        here, step = self._base[owner][parameter.name], LOCAL_STEP * parameter.scale
        ends = (max(here - step, parameter.low), min(here + step, parameter.high))
        low, high = (self._released_at(owner, parameter.name, value) for value in ends)
        change = (high - low) * (step / (ends[1] - ends[0]))
        return LocalChange(here, here + step, self._smoothed(change))

    def _smoothed(self, change: Array) -> Array:
        """What of a change (n, 5) of launches is smooth in the command, along and across the heading.

        The rest is contact's scatter, which a fit would take for knowledge of the parameter.
        """
        of = NominalLaunches(self._struck.released, np.empty((len(change), 5, 0)), self._approach)
        features = np.concatenate([launch_features(of.simulated), contact_features(of.approach)], axis=1)
        if len(change) < ROWS_A_FEATURE * features.shape[1]:
            return change
        local = np.einsum("nji,nj->ni", of.turn, change)
        fitted = features @ np.linalg.lstsq(features, local, rcond=None)[0]
        return np.asarray(np.einsum("nij,nj->ni", of.turn, fitted))

    def _released_at(self, owner: str, parameter: str, value: float) -> Array:
        """(n, 5) launches with one value changed."""
        changed = {**self._base, owner: {**self._base[owner], parameter: value}}
        return self._strike([(self._effects[name], values) for name, values in changed.items()]).released

    def launches(
        self, rows: NDArray[np.int64], reference: Execution | None = None, fitted: bool = True
    ) -> LaunchModel:
        """Launches that the commands of some of the hits should give.

        Args:
            rows: of the hits.
            reference: as in LaunchModel.
            fitted: whether launches change with effects of several parameters as simulated about those; else
                as about the nominal scene, which is enough to look at effects where they are.
        """
        readings = self._readings
        if readings is not None:
            readings = Readings(
                readings.times, readings.joints[rows], readings.nominal[rows], readings.replayed[rows]
            )
        return LaunchModel(
            self.signatures,
            self._rows[rows],
            self._struck.released[rows],
            self._struck.contact[rows],
            self._release[rows],
            self._effects,
            self._camera,
            self._starts[rows],
            self._starts_seen[rows],
            self._tracks.order[rows],
            self._tracks.object[rows],
            self._friction[rows],
            readings,
            self._approach[rows],
            self._base,
            reference,
            self._struck.turned[rows],
            {name: change.take(rows) for name, change in self._local_changes().items()} if fitted else {},
        )


def _steps_away(values: Values, at: Values, parameters: Sequence[Parameter]) -> float:
    """How far values are from others, in scales of the parameters."""
    return max(abs(values[p.name] - at[p.name]) / p.scale for p in parameters)


def _check_joints(recording: Recording, there: int) -> None:
    """Raises InputError where a recording is of another arm than the scene's."""
    for name, table in (("commands", recording.commands), ("joints", recording.joints)):
        if table is not None and len(joint_columns(table)) != there:
            raise InputError(
                f"{name} are of {len(joint_columns(table))} joints, and the arm of the scene has {there}: "
                "give the rig file of the arm that was recorded"
            )


def _longest(recording: Recording) -> float:
    assert recording.commands is not None
    return float(recording.commands["t"].max())


def pool_of(commands: Commands) -> tuple[Commands, list[str]]:
    """Every command once, and the digest of each hit's command."""
    digests = [digest_of(positions) for positions in commands.positions]
    _, first = np.unique(digests, return_index=True)
    return Commands(commands.positions[first], commands.targets[first], commands.period), digests


def _signatures(
    scene: Scene,
    commands: Commands,
    effects: Mapping[str, Effect],
    given: Signatures | None,
    threads: int,
) -> tuple[Signatures, NDArray[np.int64]]:
    """Signatures that hold the commands, and the row of each hit's."""
    pool, digests = pool_of(commands)
    if given is not None and given.holds(effects):
        rows = given.rows_of(digests)
        if rows is not None:
            return given, rows
    made = make_signatures(scene, pool, effects, threads)
    rows = made.rows_of(digests)
    assert rows is not None
    return made, rows
