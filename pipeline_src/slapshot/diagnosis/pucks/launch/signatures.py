"""How launches and joints change with everything that can change them, for a pool of commands.

Of every command: the swing and the launch that each effect of swing and contact would give at a few sizes,
and the launch's derivatives by where the object lies and by how the arm is displaced. They depend on the
scene and the commands alone, so that all recordings over one pool of commands share them.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file
from scipy.interpolate import CubicSpline, PchipInterpolator

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.launch.execution import READ_EVERY
from slapshot.diagnosis.pucks.launch.strikes import Commands, Striker
from slapshot.effects.effect import Effect, Parameter
from slapshot.errors import InputError, reading
from slapshot.progress import progress
from slapshot.scenes.scene import Scene
from slapshot.text import reason_of

LOOK = (
    0.05  # s after an object is struck at which launches are compared: contact is over, friction hardly acted
)
ONE_SIDED = (0.25, 0.75, 1.5, 3.0, 6.0)  # sizes in scales of the parameter
TWO_SIDED = (-3.0, -1.5, -0.5, 0.5, 1.5, 3.0)
START_STEP = 0.004  # m
OFFSET_STEP, RATE_STEP = 0.01, 0.05  # rad, rad/s
_NOMINAL_FRICTION = (0.4, 0.4, 0.008)


@dataclass(frozen=True)
class Signatures:
    """Of c commands, j joints, m readings and the values v of each effect's parameter.

    Attributes:
        digests: (c,) of the commands.
        contact: (c,) s of first contact.
        times: (m,) s of readings.
        joints: (c, m, j) rad of the nominal swing.
        by_start: (c, 5, 2) launch x, y, vx, vy, spin by the object's place.
        by_joints: (c, 5, 2 j) by offset (rad) and rate (rad/s) of each joint about the contact.
        values: effect/parameter -> (v,), the neutral one included, ascending.
        launches: effect/parameter -> (v, c, 5) change of the launch.
        swings: effect/parameter -> (v, c, m, j) rad, change of the readings.
        dropped: effect -> why it could not be simulated.
    """

    digests: tuple[str, ...]
    contact: Array
    times: Array
    joints: Array
    by_start: Array
    by_joints: Array
    values: Mapping[str, Array]
    launches: Mapping[str, Array]
    swings: Mapping[str, Array]
    dropped: Mapping[str, str] = field(default_factory=dict)

    def rows_of(self, digests: Sequence[str]) -> NDArray[np.int64] | None:
        """Rows of commands; None if any is missing."""
        place = {digest: i for i, digest in enumerate(self.digests)}
        if any(d not in place for d in digests):
            return None
        return np.array([place[d] for d in digests], np.int64)

    def holds(self, effects: Mapping[str, Effect]) -> bool:
        """Whether every one of the effects was simulated, with all parameters that it has today."""
        wanted = {
            f"{effect.name}/{parameter.name}"
            for effect in effects.values()
            if _is_simulated(effect) and effect.name not in self.dropped
            for parameter in effect.parameters
            if sizes_of(parameter)
        }
        return wanted <= self.values.keys()

    def swing(
        self, rows: NDArray[np.int64], times: Array, effects: Mapping[str, Mapping[str, float]] | None = None
    ) -> tuple[Array, Array]:
        """Joint angles and speeds (n, times, j) in rad and rad/s of some commands, under effects."""
        joints = self.joints[rows]
        for owner, values in (effects or {}).items():
            for parameter, value in values.items():
                known = self.values.get(f"{owner}/{parameter}")
                if known is not None:
                    inside = np.clip(value, known[0], known[-1])
                    swings = self.swings[f"{owner}/{parameter}"][:, rows]
                    joints = joints + PchipInterpolator(known, swings)(inside)
        spline = CubicSpline(self.times, joints, axis=1)
        return np.asarray(spline(times), float), np.asarray(spline(times, 1), float)

    def swing_at(self, rows: NDArray[np.int64], moments: Array) -> tuple[Array, Array, Array]:
        """Nominal joint angles, speeds and accelerations (n, j) of some commands, each at its own moment.

        In rad, rad/s and rad/s^2.
        """
        splines = [CubicSpline(self.times, self.joints[row]) for row in rows]
        q, v, a = (np.stack([s(t, k) for s, t in zip(splines, moments, strict=True)]) for k in range(3))
        return q, v, a

    def save(self, file: Path, scene: Scene | None = None) -> None:
        """Write one safetensors file; joint angles in single precision.

        Args:
            file: to write.
            scene: that commands were simulated in, for `load` to compare with.
        """
        arrays = {
            "contact": self.contact,
            "times": self.times,
            "joints": self.joints,
            "by_start": self.by_start,
            "by_joints": self.by_joints,
            "digests": np.array([list(bytes.fromhex(d)) for d in self.digests], np.uint8),
        }
        for name in self.values:
            arrays[f"values:{name}"] = self.values[name]
            arrays[f"launches:{name}"] = self.launches[name]
            arrays[f"swings:{name}"] = self.swings[name].astype(np.float32)
        metadata = {"dropped": json.dumps(dict(self.dropped))}
        if scene is not None:
            metadata["scene"] = _digest_of_scene(scene)
        save_file({k: np.ascontiguousarray(v) for k, v in arrays.items()}, file, metadata)

    @classmethod
    def load(cls, file: Path, scene: Scene | None = None) -> "Signatures":
        """Read what `save` wrote.

        Args:
            file: to read.
            scene: that they must be of, where the file says of which they are.

        Raises:
            InputError: the file holds no signatures, or those of another scene.
        """
        remedy = "name the file that an earlier diagnosis made, or one that does not exist yet"
        with reading(file, remedy):
            file.open("rb").close()
        try:
            with safe_open(file, "numpy") as opened:
                arrays: dict[str, Any] = {n: opened.get_tensor(n) for n in opened.keys()}  # noqa: SIM118
                metadata = opened.metadata()
            made = cls._of(arrays, json.loads(metadata["dropped"]))
        except (SafetensorError, KeyError, TypeError, ValueError) as error:
            raise InputError(f"{file}: holds no signatures ({reason_of(error)}); {remedy}") from None
        if scene is not None and metadata.get("scene", _digest_of_scene(scene)) != _digest_of_scene(scene):
            raise InputError(f"{file}: holds signatures of another scene; {remedy}")
        return made

    @classmethod
    def _of(cls, arrays: Mapping[str, Any], dropped: Mapping[str, str]) -> "Signatures":
        parts: dict[str, Any] = {
            kind: {k.partition(":")[2]: v for k, v in arrays.items() if k.startswith(f"{kind}:")}
            for kind in ("values", "launches", "swings")
        }
        single = {k: arrays[k] for k in ("contact", "times", "joints", "by_start", "by_joints")}
        digests = tuple(bytes(row).hex() for row in arrays["digests"])
        return cls(digests=digests, **single, **parts, dropped=dropped)


def _digest_of_scene(scene: Scene) -> str:
    return hashlib.sha256(scene.xml.encode()).hexdigest()


def digest_of(positions: Array) -> str:
    """Of one command (ticks, joints), to a microradian."""
    return hashlib.sha256(np.round(positions, 6).astype("<f8").tobytes()).hexdigest()[:32]


def sizes_of(parameter: Parameter) -> list[float]:
    """Values at which an effect is simulated, within its bounds."""
    sizes = ONE_SIDED if parameter.low == parameter.neutral else TWO_SIDED
    values = [parameter.neutral + size * parameter.scale for size in sizes]
    return [v for v in values if parameter.low <= v <= parameter.high]


def _is_simulated(effect: Effect) -> bool:
    """Whether it changes commands or the model; what shifts launches otherwise needs no simulation."""
    return type(effect).command is not Effect.command or type(effect).edit is not Effect.edit


def make_signatures(
    scene: Scene, commands: Commands, effects: Mapping[str, Effect], threads: int
) -> Signatures:
    """Simulate every command with every effect of swing and contact at every size."""
    count, ticks, joints = commands.positions.shape
    mass = float(scene.compile().body(scene.info.object_body).mass[0])
    start = np.tile(np.array(scene.info.start), (count, 1))
    end = (ticks - 1) * commands.period
    times = np.arange(0.0, end + 1e-9, READ_EVERY)

    def striker(releases: Array, readings: Array) -> Striker:
        friction = np.tile(_NOMINAL_FRICTION, (count, 1))
        return Striker(scene, commands, releases, np.full(count, mass), friction, readings, threads)

    first = striker(np.full(count, end), times[:1]).strike(start).contact
    contact = np.where(np.isnan(first), end - LOOK, first)
    looks = np.minimum(contact + LOOK, end)
    simulate, launch_only = striker(looks, times), striker(looks, times[:1])
    nominal = simulate.strike(start)
    by_start = np.stack(
        [
            (launch_only.strike(start + step).released - nominal.released) / START_STEP
            for step in START_STEP * np.eye(2)
        ],
        axis=-1,
    )
    moved = []
    for j in range(2 * joints):
        offset, rate = np.zeros(joints), np.zeros(joints)
        if j < joints:
            offset[j] = OFFSET_STEP
        else:
            rate[j - joints] = RATE_STEP
        displaced = launch_only.strike_displaced(start, offset, rate, contact)
        moved.append((displaced.released - nominal.released) / (OFFSET_STEP if j < joints else RATE_STEP))
    plan = [
        (effect, parameter, value)
        for effect in effects.values()
        if _is_simulated(effect)
        for parameter in effect.parameters
        for value in sizes_of(parameter)
    ]
    found: dict[str, list[tuple[float, Array, Array]]] = {}
    dropped: dict[str, str] = {}
    for effect, parameter, value in progress(plan, len(plan), "signatures"):
        if effect.name in dropped:
            continue
        try:
            struck = simulate.strike(start, [(effect, {**effect.neutral(), parameter.name: value})], contact)
        except (Exception, SystemExit) as error:  # an effect may be anybody's code
            dropped[effect.name] = reason_of(error)
            continue
        if not (np.isfinite(struck.released).all() and np.isfinite(struck.joints).all()):
            dropped[effect.name] = "it is not finite"
            continue
        change = (value, struck.released - nominal.released, struck.joints - nominal.joints)
        found.setdefault(f"{effect.name}/{parameter.name}", []).append(change)
    found = {n: changes for n, changes in found.items() if n.partition("/")[0] not in dropped}
    for name, changes in found.items():
        neutral = effects[name.partition("/")[0]].neutral()[name.partition("/")[2]]
        changes.append((neutral, np.zeros((count, 5)), np.zeros((count, len(times), joints))))
        changes.sort(key=lambda change: change[0])
    return Signatures(
        digests=tuple(digest_of(p) for p in commands.positions),
        contact=contact,
        times=times,
        joints=nominal.joints,
        by_start=by_start,
        by_joints=np.stack(moved, axis=-1),
        values={n: np.array([c[0] for c in changes]) for n, changes in found.items()},
        launches={n: np.stack([c[1] for c in changes]) for n, changes in found.items()},
        swings={n: np.stack([c[2] for c in changes]) for n, changes in found.items()},
        dropped=dropped,
    )
