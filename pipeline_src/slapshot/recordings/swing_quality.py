"""What is odd in a recording's commands and joints: rows that lack, clocks that differ, units, jumps."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from slapshot.arrays import Array
from slapshot.recordings.format import Recording, joint_columns
from slapshot.recordings.plausibility import LARGEST_ANGLE_RAD
from slapshot.recordings.quality_warning import QualityWarning, WarningKind

_FEWEST_ROWS = 3
_FASTEST_RAD_S = 30.0  # twice as fast as any arm turns
_JUMP_RAD = np.pi  # between two rows; an encoder that starts over jumps by twice that
# Joints that follow their commands lie nearer to them than this share of the swing, and of a radian.
_FOLLOWS, _LEAST_APART_RAD = 0.5, 0.05
_EXPLAINS = 0.3  # of the difference, and of the swing, may be left where another clock is the reason
_LEAST_OVERLAP = 0.5  # of the shorter one of commands and joints; less says nothing
_LEAST_LATE_S = 0.1
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

    def apart(self, late_s: float = 0.0) -> float:
        """Root mean square of measured less commanded positions in rad, commands `late_s` later."""
        return _apart(self.commanded, self.measured, late_s)

    @property
    def reversed(self) -> float:
        """As `apart`, with the joints backwards in time."""
        t = self.measured[:, :1]
        return _apart(self.commanded, np.hstack([t[0] + t[-1] - t[::-1], self.measured[::-1, 1:]]), 0.0)

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
        return float(lags[np.argmin([self.apart(lag) for lag in lags])])


def odd_swings(recording: Recording) -> Iterator[QualityWarning]:
    """What is odd in commands and joints."""
    commands, joints = recording.commands, recording.joints
    for table, word in ((commands, "commands"), (joints, "joints")):
        if table is not None:
            yield from odd_angles(table, word)
    if commands is None or joints is None:
        return
    yield from lacking_rows(recording.hits["hit"], commands, joints)
    yield from odd_following(_swings(commands, joints))


def odd_angles(table: pd.DataFrame, word: str) -> Iterator[QualityWarning]:
    """Hits with hardly a row, angles and speeds of another unit, and jumps.

    Args:
        table: of commands or joints.
        word: which of them.
    """
    rows = table.sort_values(["hit", "t"], kind="stable")
    of_hit = rows.groupby("hit")
    few = of_hit.size()
    few = few[few < _FEWEST_ROWS]
    if len(few):
        yield QualityWarning(
            "few_rows",
            f"{len(few)} of {of_hit.ngroups} hits have fewer than {_FEWEST_ROWS} rows of {word}",
            tuple(map(int, few.index)),
            "how the arm moved between them is not known",
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
            "no arm turns so far or so fast: these look like degrees, or times are in another unit",
        )
    jumps = pd.Series(steps.max(axis=1) > _JUMP_RAD, index=rows["hit"]).groupby(level=0).sum()
    jumps = jumps[(jumps > 0) & ~jumps.index.isin(degrees)]
    if len(jumps):
        yield QualityWarning(
            "joint_jumps",
            f"{word} jump by more than {_JUMP_RAD:.1f} rad between two rows in {len(jumps)} of "
            f"{of_hit.ngroups} hits, {jumps.sum()} times",
            tuple(map(int, jumps.index)),
            "an encoder that starts over, or rows that are lost: the swing between them is not known",
        )


def lacking_rows(hits: pd.Series, commands: pd.DataFrame, joints: pd.DataFrame) -> Iterator[QualityWarning]:
    """Hits whose swing was only commanded or only measured."""
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
                "how well the arm followed is not known in these; export their rows, or leave the hits out",
            )


def odd_following(swings: list[Swing]) -> Iterator[QualityWarning]:
    """Joints that do not go where the commands send them, and whether another clock explains it."""
    late: dict[int, float] = {}
    backwards, astray = [], {}
    for swing in swings:
        apart = swing.apart()
        if apart < max(_FOLLOWS * swing.size, _LEAST_APART_RAD):
            continue
        lag, explained = swing.lag, _EXPLAINS * min(apart, swing.size)
        if swing.reversed < explained:
            backwards.append(swing.hit)
        elif abs(lag) > _LEAST_LATE_S and swing.apart(lag) < explained:
            late[swing.hit] = lag
        else:
            astray[swing.hit] = swing.apart(lag)
    if backwards:
        yield QualityWarning(
            "joints_reversed",
            f"in {len(backwards)} of {len(swings)} hits joints follow their commands only backwards in time",
            tuple(backwards),
            "the rows are in the wrong order: what the arm did is told the wrong way round",
        )
    if late:
        yield QualityWarning(
            "joints_late",
            f"in {len(late)} of {len(swings)} hits joints follow their commands "
            f"{np.median(list(late.values())):.2g} s late (median)",
            tuple(late),
            "two clocks, or times that begin at different moments: it looks like a slow arm",
        )
    if astray:
        yield QualityWarning(
            "joints_astray",
            f"in {len(astray)} of {len(swings)} hits joints are not where the commands send them: at "
            f"best {np.median(list(astray.values())):.2g} rad off (root mean square, median over hits)",
            tuple(astray),
            "another hit's rows, joints in another order or unit, or an arm that did not move",
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
        if hit in measured and min(len(rows), len(measured[hit])) >= _FEWEST_ROWS
    ]


def _apart(commanded: Array, measured: Array, late_s: float) -> float:
    """Of the rows measured while there are commands; infinite where these are too few."""
    t = measured[:, 0] - late_s
    begin, end = max(t[0], commanded[0, 0]), min(t[-1], commanded[-1, 0])
    during = (t >= begin) & (t <= end)
    shorter = min(np.ptp(t), np.ptp(commanded[:, 0]))
    if during.sum() < _FEWEST_ROWS or end - begin < _LEAST_OVERLAP * shorter:
        return float("inf")
    t = t[during]
    wanted = np.stack([np.interp(t, commanded[:, 0], q) for q in commanded[:, 1:].T], axis=1)
    return float(np.sqrt(np.mean((measured[during, 1:] - wanted) ** 2)))
