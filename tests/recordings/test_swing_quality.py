"""What is odd in commands, joints, places and order: each oddity is put into good hits."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from slapshot.recordings.data_quality import quality_warnings
from slapshot.recordings.quality_warning import WarningKind
from slapshot.recordings.read import read_recording
from slapshot.recordings.write import write_recording

from .slide_tracks import recording_of, varied_slides

HITS = 30
NOISE = 0.001
Tables = dict[str, pd.DataFrame]


def swing(frame: pd.DataFrame, turns: float = 0.6) -> np.ndarray:
    """(n, 3) joint positions in rad of a swing that takes a second, then holds."""
    t, hit = np.clip(frame["t"].to_numpy(), 0, 1), frame["hit"].to_numpy()
    # There and half the way back: backwards in time it is another swing.
    way = np.sin(0.75 * np.pi * t**2)
    return np.stack([way * turns * (1 + 0.01 * hit), 0.3 - 0.5 * way, 1.2 + 0.2 * t], axis=1)


def joint_rows(length_s: float, noise: float) -> pd.DataFrame:
    t = np.arange(round(100 * length_s) + 1) / 100
    frame = pd.DataFrame({"hit": np.repeat(np.arange(HITS), len(t)), "t": np.tile(t, HITS)})
    rng = np.random.default_rng(3)
    q = swing(frame) + rng.normal(0, noise, (len(frame), 3))
    return frame.assign(q0=q[:, 0], q1=q[:, 1], q2=q[:, 2])


@pytest.fixture
def good() -> Tables:
    """Tables of hits whose joints follow their commands 30 ms late."""
    recording = recording_of(varied_slides(HITS))
    joints = joint_rows(1.5, NOISE)
    joints["t"] += 0.03
    assert recording.tracks is not None
    return {
        "hits": recording.hits,
        "tracks": recording.tracks,
        "commands": joint_rows(1.0, 0.0),
        "joints": joints,
    }


def found(tables: Tables, folder: Path) -> dict[WarningKind, tuple[int, ...]]:
    """Kind -> hits; what is refused cannot be odd, so it is written and read."""
    write_recording(dataclasses.replace(recording_of(varied_slides(HITS)), **tables), folder)
    return {f.kind: f.hits for f in quality_warnings(read_recording(folder)) if f.kind != "no_clock"}


def late(tables: Tables) -> None:
    tables["joints"].loc[tables["joints"]["hit"] < 4, "t"] += 0.4


def reverse(tables: Tables) -> None:
    joints = tables["joints"]
    for hit in (5, 6):
        rows = joints.index[(joints["hit"] == hit) & (joints["t"] <= 1.035)]
        joints.loc[rows, ["q0", "q1", "q2"]] = joints.loc[rows[::-1], ["q0", "q1", "q2"]].to_numpy()
    tables["joints"] = joints[joints["t"] <= 1.035]


def swap_joints(tables: Tables) -> None:
    joints = tables["joints"]
    rows = joints["hit"] == 7
    joints.loc[rows, ["q0", "q1", "q2"]] = joints.loc[rows, ["q2", "q0", "q1"]].to_numpy()


def lose_joints(tables: Tables) -> None:
    tables["joints"] = tables["joints"][~tables["joints"]["hit"].isin([3, 9])]


def lose_commands(tables: Tables) -> None:
    tables["commands"] = tables["commands"][tables["commands"]["hit"] != 8]


def keep_two_rows(tables: Tables) -> None:
    commands = tables["commands"]
    tables["commands"] = commands[(commands["hit"] != 2) | commands["t"].isin([0.0, 1.0])]


def degrees(tables: Tables) -> None:
    for name in ("commands", "joints"):
        tables[name]["q1"] *= 180 / np.pi  # from 17 to -11: most rows are small


def wrap(tables: Tables) -> None:
    joints = tables["joints"]
    joints.loc[(joints["hit"] == 11) & (joints["t"] > 0.7), "q2"] -= 2 * np.pi


def stray(tables: Tables) -> None:
    tables["tracks"].loc[[10, 11], "x"] = 5000.0
    tables["hits"].loc[4, "rest_x"] = 300.0


def centimetres(tables: Tables) -> None:
    for name, columns in (("tracks", ["x", "y"]), ("hits", ["start_x", "start_y", "rest_x", "rest_y"])):
        tables[name][columns] *= 15.0


def same_order(tables: Tables) -> None:
    tables["hits"].loc[5, "order"] = 4


def dates_backwards(tables: Tables) -> None:
    when = list(pd.date_range("2026-01-01", periods=HITS, freq="min", tz="UTC"))
    when[12], when[13] = when[13], when[12]
    tables["hits"]["recorded_at"] = when


CASES: dict[str, tuple[Callable[[Tables], None], WarningKind, tuple[int, ...]]] = {
    "joints late": (late, "joints_late", (0, 1, 2, 3)),
    "joints reversed": (reverse, "joints_reversed", (5, 6)),
    "joints in another order": (swap_joints, "joints_astray", (7,)),
    "hits without joints": (lose_joints, "no_joints", (3, 9)),
    "hits without commands": (lose_commands, "no_commands", (8,)),
    "two rows": (keep_two_rows, "few_rows", (2,)),
    "degrees": (degrees, "joint_units", tuple(range(HITS))),
    "an encoder that starts over": (wrap, "joint_jumps", (11,)),
    "places of no table": (stray, "far_places", (0, 4)),
    "centimetres": (centimetres, "implausible_slides", ()),
    "a place in the order twice": (same_order, "order_repeats", (4, 5)),
    "dates backwards": (dates_backwards, "order_dates", (13,)),
}


def test_nothing_is_odd_in_good_swings(good: Tables, tmp_path: Path) -> None:
    assert found(good, tmp_path / "r") == {}


@pytest.mark.parametrize(("spoil", "kind", "hits"), CASES.values(), ids=CASES)
def test_each_oddity_is_told_with_its_hits(
    good: Tables, tmp_path: Path, spoil: Callable[[Tables], None], kind: WarningKind, hits: tuple[int, ...]
) -> None:
    spoil(good)
    assert found(good, tmp_path / "r").get(kind) == hits
