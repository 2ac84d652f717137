"""Quality warnings about commands and joints: missing rows, clock offsets, units, jumps."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from slapshot.arrays import Array
from slapshot.recordings.format import Recording, joint_columns
from slapshot.recordings.plausibility import LARGEST_ANGLE_RAD
from slapshot.recordings.quality_warning import QualityWarning, WarningKind

_MIN_ROWS = 3
_FASTEST_RAD_S = 30.0  # twice as fast as any arm turns
_JUMP_RAD = np.pi  # between two rows; an encoder that starts over jumps by twice that
# Joints that follow their commands deviate by less than this share of the swing, and of a radian.
_FOLLOWS, _MIN_ERROR_RAD = 0.5, 0.05
_EXPLAINS = 0.3  # of the error, and of the swing, may remain where a clock offset is the reason
_MIN_OVERLAP = 0.5  # of the shorter of commands and joints
_MIN_DELAY_S = 0.1
_LAGS = 100


@dataclass(frozen=True)
class Swing:
    """Commands and joints of a hit that has both.

    Attributes:
        hit: its number.
        commanded: (n, 1 + joints) t in s, q in rad.
        measured: (m, 1 + joints) the same.
    """

    hit: int
    commanded: Array
    measured: Array

    def tracking_rms(self, delay_s: float = 0.0) -> float:
        """Root mean square of measured less commanded positions in rad, commands `late_s` later."""
        return _tracking_rms(self.commanded, self.measured, delay_s)

    @property
    def reversed(self) -> float:
        """As `tracking_rms`, with the joints reversed in time."""
        t = self.measured[:, :1]
        return _tracking_rms(
            self.commanded, np.hstack([t[0] + t[-1] - t[::-1], self.measured[::-1, 1:]]), 0.0
        )

    @property
    def size(self) -> float:
        """Root mean square of the commanded positions about their mean in rad."""
        q = self.commanded[:, 1:]
        return float(np.sqrt(np.mean((q - q.mean(axis=0)) ** 2)))

    @property
    def lag(self) -> float:
        """Time in s by which the joints follow their commands best."""
        length = self.commanded[-1, 0] - self.commanded[0, 0]
        lags = np.linspace(-length, length, 2 * _LAGS + 1)
        return float(lags[np.argmin([self.tracking_rms(lag) for lag in lags])])


def swing_warnings(recording: Recording) -> Iterator[QualityWarning]:
    """Quality warnings about commands and joints."""
    commands, joints = recording.commands, recording.joints
    for table, word in ((commands, "commands"), (joints, "joints")):
        if table is not None:
            yield from joint_angle_warnings(table, word)
    if commands is None or joints is None:
        return
    yield from unmatched_row_warnings(recording.hits["hit"], commands, joints)
    yield from tracking_warnings(_swings(commands, joints))


def joint_angle_warnings(table: pd.DataFrame, word: str) -> Iterator[QualityWarning]:
    """Hits with too few rows, angles and speeds in a wrong unit, and jumps.

    Args:
        table: of commands or joints.
        word: which of them.
    """
    rows = table.sort_values(["hit", "t"], kind="stable")
    of_hit = rows.groupby("hit")
    few = of_hit.size()
    few = few[few < _MIN_ROWS]
    if len(few):
        yield QualityWarning(
            "few_rows",
            f"{len(few)} of {of_hit.ngroups} hits have fewer than {_MIN_ROWS} rows of {word}",
            tuple(map(int, few.index)),
            "the motion of the arm between them is unknown",
        )
    names = joint_columns(table)
    q = rows[names].to_numpy()
    steps = np.abs(of_hit[names].diff().to_numpy())
    fast = pd.Series((steps / of_hit["t"].diff().to_numpy()[:, None]).max(axis=1), index=rows["hit"])
    fastest = fast.groupby(level=0).quantile(0.95)
    wide = pd.Series(np.abs(q).max(axis=1), index=rows["hit"]).groupby(level=0).max()
    degrees = wide.index[(wide > LARGEST_ANGLE_RAD) | (fastest > _FASTEST_RAD_S)]
    if len(degrees):
        yield QualityWarning(
            "joint_units",
            f"in {len(degrees)} of {of_hit.ngroups} hits {word} reach {wide[degrees].max():.3g} rad and turn "
            f"at {fastest[degrees].max():.3g} rad/s (95 % of rows are slower)",
            tuple(map(int, degrees)),
            "no arm turns this far or fast: these may be degrees, or times are in another unit",
        )
    jumps = pd.Series(steps.max(axis=1) > _JUMP_RAD, index=rows["hit"]).groupby(level=0).sum()
    jumps = jumps[(jumps > 0) & ~jumps.index.isin(degrees)]
    if len(jumps):
        yield QualityWarning(
            "joint_jumps",
            f"{word} jump by more than {_JUMP_RAD:.1f} rad between two rows in {len(jumps)} of "
            f"{of_hit.ngroups} hits, {jumps.sum()} times",
            tuple(map(int, jumps.index)),
            "an encoder reset or lost rows: the swing between them is unknown",
        )


def unmatched_row_warnings(
    hits: pd.Series, commands: pd.DataFrame, joints: pd.DataFrame
) -> Iterator[QualityWarning]:
    """Hits with commands but no joints, or joints but no commands."""
    commanded, measured = set(commands["hit"]), set(joints["hit"])
    cases: tuple[tuple[WarningKind, set[int], str, str], ...] = (
        ("no_joints", commanded - measured, "commands", "joints"),
        ("no_commands", measured - commanded, "joints", "commands"),
    )
    for kind, lacking, there, word in cases:
        if lacking:
            yield QualityWarning(
                kind,
                f"{len(lacking)} of {len(hits)} hits have {there}, but no {word}",
                tuple(int(hit) for hit in hits if hit in lacking),
                "tracking cannot be evaluated for these; export their rows, or exclude the hits",
            )


def tracking_warnings(swings: list[Swing]) -> Iterator[QualityWarning]:
    """Joints that do not follow their commands, and whether a clock offset explains it."""
    delays: dict[int, float] = {}
    time_reversed, off_track = [], {}
    for swing in swings:
        tracking_rms = swing.tracking_rms()
        if tracking_rms < max(_FOLLOWS * swing.size, _MIN_ERROR_RAD):
            continue
        lag, explained = swing.lag, _EXPLAINS * min(tracking_rms, swing.size)
        if swing.reversed < explained:
            time_reversed.append(swing.hit)
        elif abs(lag) > _MIN_DELAY_S and swing.tracking_rms(lag) < explained:
            delays[swing.hit] = lag
        else:
            off_track[swing.hit] = swing.tracking_rms(lag)
    if time_reversed:
        yield QualityWarning(
            "joints_reversed",
            f"in {len(time_reversed)} of {len(swings)} hits joints follow their commands only backwards in "
            "time",
            tuple(time_reversed),
            "the rows are in the wrong order: the motion is reversed",
        )
    if delays:
        yield QualityWarning(
            "joints_late",
            f"in {len(delays)} of {len(swings)} hits joints follow their commands "
            f"{np.median(list(delays.values())):.2g} s late (median)",
            tuple(delays),
            "two clocks, or different time zeros: it is mistaken for a slow arm",
        )
    if off_track:
        yield QualityWarning(
            "joints_astray",
            f"in {len(off_track)} of {len(swings)} hits joints do not follow their commands: at "
            f"best {np.median(list(off_track.values())):.2g} rad off (root mean square, median over hits)",
            tuple(off_track),
            "rows of another hit, joints in another order or unit, or an arm that did not move",
        )


def _swings(commands: pd.DataFrame, joints: pd.DataFrame) -> list[Swing]:
    columns = ["t", *joint_columns(commands)]
    commanded, measured = (
        {int(rows["hit"].iloc[0]): rows[columns].to_numpy(np.float64) for _, rows in table.groupby("hit")}
        for table in (commands, joints)
    )
    return [
        Swing(hit, rows, measured[hit])
        for hit, rows in commanded.items()
        if hit in measured and min(len(rows), len(measured[hit])) >= _MIN_ROWS
    ]


def _tracking_rms(commanded: Array, measured: Array, delay_s: float) -> float:
    """Tracking error over the rows measured while there are commands; infinite if there are too few."""
    t = measured[:, 0] - delay_s
    begin, end = max(t[0], commanded[0, 0]), min(t[-1], commanded[-1, 0])
    during = (t >= begin) & (t <= end)
    shorter = min(np.ptp(t), np.ptp(commanded[:, 0]))
    if during.sum() < _MIN_ROWS or end - begin < _MIN_OVERLAP * shorter:
        return float("inf")
    t = t[during]
    wanted = np.stack([np.interp(t, commanded[:, 0], q) for q in commanded[:, 1:].T], axis=1)
    return float(np.sqrt(np.mean((measured[during, 1:] - wanted) ** 2)))
