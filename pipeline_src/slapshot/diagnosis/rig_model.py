"""The launch model of a recording whose commands are known: one simulation of all hits, and signatures."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from slapshot.diagnosis.execution import Execution, Readings, readings_of, replay
from slapshot.diagnosis.launch import LaunchModel
from slapshot.diagnosis.signatures import LOOK, Signatures, digest_of, make_signatures
from slapshot.diagnosis.strikes import Commands, Striker, Strikes, commands_of
from slapshot.diagnosis.tracks import HitTracks
from slapshot.effects.effect import Effect
from slapshot.recordings.format import Recording
from slapshot.scenes.scene import Scene

Array = NDArray[np.float64]


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
            tracks: of its hits.
            scene: nominal.
            effects: that may act.
            camera: (2,) m, point of the plane that the camera looks at.
            friction: (objects, 3) as fitted to the slides.
            signatures: of a pool that holds the commands; None, or one that lacks some, has them made.
            threads: for simulations.
        """
        self._tracks, self._effects, self._camera = tracks, effects, camera
        period = scene.info.control_period
        latest = max(float(tracks.release.max()), _longest(recording)) + 2 * LOOK
        commands = commands_of(recording, tracks, scene, latest)
        # To a length of its own, so that digests do not depend on when objects were released.
        whole = commands_of(recording, tracks, scene, _longest(recording) + 2 * LOOK)
        self.signatures, self._rows = _signatures(scene, whole, effects, signatures, threads)
        seen = np.isnan(tracks.seen_start)
        self._starts = np.where(seen, tracks.start, tracks.seen_start)
        mass = np.array([recording.objects[tracks.objects[k]].mass_kg for k in tracks.object])
        times, joints = np.zeros(1), None
        if recording.joints is not None:
            times, joints = readings_of(
                recording.joints, tracks.hit, period, float(self.signatures.times[-1])
            )
        friction = friction[tracks.object]

        def strike(executed: Commands) -> Strikes:
            striker = Striker(scene, executed, tracks.release, mass, friction, times, threads)
            return striker.strike(self._starts)

        self._readings: Readings | None = None
        if joints is None:
            self._struck = strike(commands)
            return
        swing, speeds = self.signatures.swing(self._rows, times)
        execution = Execution(times, joints - swing, speeds)
        replayed, _ = execution.coefficients(execution.residual)
        # As the hits were executed, not as they were commanded: launches are not linear in the difference.
        positions = replay(commands.positions, period, float(times[-1]), replayed)
        rates = np.gradient(positions, period, axis=1)
        self._struck = strike(Commands(positions, positions + scene.info.servo_time * rates, period))
        self._readings = Readings(times, joints, self._struck.joints, replayed)

    def launches(self, rows: NDArray[np.int64]) -> LaunchModel:
        """Launches that the commands of some of the hits should give."""
        readings = self._readings
        if readings is not None:
            readings = Readings(
                readings.times, readings.joints[rows], readings.nominal[rows], readings.replayed[rows]
            )
        return LaunchModel(
            self.signatures,
            self._rows[rows],
            self._struck.released[rows],
            self._tracks.release[rows],
            self._effects,
            self._camera,
            self._starts[rows],
            readings,
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
    if given is not None:
        rows = given.rows_of(digests)
        if rows is not None:
            return given, rows
    made = make_signatures(scene, pool, effects, threads)
    rows = made.rows_of(digests)
    assert rows is not None
    return made, rows
