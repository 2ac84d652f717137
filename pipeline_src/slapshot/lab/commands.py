"""Commands of a session: safe ones, some of them repeated, all in random order."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.config.lab import StandIns
from slapshot.config.trajectories import ScriptedHits
from slapshot.errors import InputError
from slapshot.parquet import read_table
from slapshot.scenes.domain import Domain
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion
from slapshot.trajectories.safety import SafetyCheck

_TRIES_PER_COMMAND = 20


@dataclass(frozen=True, eq=False)
class Command:
    """One command.

    Attributes:
        motion: of the arm.
        latent: (latent,) that the motion was decoded from; None if it was not decoded from one.
        task: parameters of the scripted hit by name; None if the motion was not scripted.
    """

    motion: Motion
    latent: Array | None
    task: Mapping[str, float] | None


class Source(Protocol):
    """Source of commands."""

    @property
    def trajectory_model(self) -> str | None:
        """Version of the model that decodes latents; None if the recording is to hold no latents."""

    def draw(self, count: int, check: SafetyCheck, rng: np.random.Generator) -> list[Command]:
        """Draw commands that pass the safety check.

        Raises:
            InputError: too few are safe.
        """


@dataclass(frozen=True)
class Latents:
    """Commands decoded from z ~ N(0, I).

    Attributes:
        motion: decodes a latent (latent,).
        size: dimension of a latent.
        trajectory_model: version of the model behind `motion`; None to record no latents.
    """

    motion: Callable[[Array], Motion]
    size: int
    trajectory_model: str | None

    def draw(self, count: int, check: SafetyCheck, rng: np.random.Generator) -> list[Command]:
        """Sample latents one by one until enough are safe."""
        found: list[Command] = []
        for _ in range(_TRIES_PER_COMMAND * count):
            if len(found) == count:
                break
            z = rng.normal(size=self.size)
            motion = self.motion(z)
            if check.report(motion).safe:
                found.append(Command(motion, z, None))
        if len(found) < count:
            raise InputError(
                f"lab: only {len(found)} of {_TRIES_PER_COMMAND * count} sampled latents are safe; train "
                "the trajectory model longer or on narrower demonstrations"
            )
        return found


@dataclass(frozen=True)
class Diverse:
    """Scripted commands of the domain, in all directions and speeds that its arm can execute.

    Attributes:
        scene: of the rig.
        domain: generates the scripted hits.
        settings: as for demonstrations: ranges of tasks, duration_s and waypoints.
    """

    scene: Scene
    domain: Domain
    settings: ScriptedHits
    trajectory_model: str | None = None

    def draw(self, count: int, check: SafetyCheck, rng: np.random.Generator) -> list[Command]:
        """Draw tasks one by one until enough are within reach and safe."""
        found: list[Command] = []
        for _ in range(_TRIES_PER_COMMAND):
            tasks = [self.domain.draw_task(self.settings, rng) for _ in range(count)]
            for task, waypoints in zip(
                tasks, self.domain.demonstrate(self.scene, self.settings, tasks), strict=True
            ):
                if waypoints is None:
                    continue
                motion = Motion.through(waypoints, self.settings.duration_s)
                if check.report(motion).safe:
                    found.append(Command(motion, None, task))
            if len(found) >= count:
                return found[:count]
        raise InputError(
            f"lab.commands.diverse: only {len(found)} of {_TRIES_PER_COMMAND * count} tasks can be executed "
            "safely; narrow heading_rad, speed_m_s or contact_offset_m"
        )


@dataclass(frozen=True, eq=False)
class Pool:
    """Commands from a pool that several sessions share.

    Attributes:
        motions: all motions of the pool, known to be safe.
    """

    motions: Sequence[Motion]
    trajectory_model: str | None = None

    @classmethod
    def load(cls, file: Path, count: int, duration: float, joints: int) -> "Pool":
        """Read the first `count` demonstrations of a Parquet file, each of which lasts `duration` s."""
        waypoints = np.stack(read_table(file)["waypoints"].to_numpy()[:count]).astype(float)
        return cls([Motion.through(w.reshape(-1, joints), duration) for w in waypoints])

    def draw(self, count: int, check: SafetyCheck, rng: np.random.Generator) -> list[Command]:
        """Draw from the pool without replacement."""
        if count > len(self.motions):
            raise InputError(
                f"lab.commands: a session of {count} commands is more than the {len(self.motions)} of its "
                "pool; raise the pool's count or lower lab.hits"
            )
        chosen = rng.permutation(len(self.motions))[:count]
        return [Command(self.motions[i], None, None) for i in chosen]


@dataclass(frozen=True, eq=False)
class Session:
    """Hits in the order of execution.

    Attributes:
        commands: the distinct commands of the session.
        command: (hits,) index into `commands` of each hit.
        object_ids: object of each hit.
    """

    commands: Sequence[Command]
    command: NDArray[np.int64]
    object_ids: tuple[str, ...]


def draw_session(
    settings: StandIns,
    object_ids: Sequence[str],
    source: Source,
    check: SafetyCheck,
    rng: np.random.Generator,
) -> Session:
    """Draw the commands of a session and their order.

    Every object gets `hits` hits. They include the repeats: the same `commands` for every object, each
    executed `times` times. All other commands are executed once.

    Args:
        settings: hits of each object, and repeats.
        object_ids: the objects to hit.
        source: draws the commands.
        check: rejects unsafe motions.
        rng: source of randomness.

    Raises:
        InputError: too few commands are safe.
    """
    repeated, times = settings.repeats.commands, settings.repeats.times
    single = settings.hits - repeated * times
    commands = source.draw(repeated + single * len(object_ids), check, rng)
    command: list[int] = []
    hit_objects: list[str] = []
    for i, object_id in enumerate(object_ids):
        first = repeated + i * single
        command += np.repeat(np.arange(repeated), times).tolist() + list(range(first, first + single))
        hit_objects += [object_id] * settings.hits
    order = rng.permutation(len(command))
    return Session(
        commands=commands,
        command=np.array(command, np.int64)[order],
        object_ids=tuple(hit_objects[i] for i in order),
    )
