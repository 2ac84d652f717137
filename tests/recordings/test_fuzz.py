"""Good recordings changed at random: each is refused in one line, or described and its oddities told.

Seeded: a number that fails is the seed of its case.
"""

import dataclasses
import re
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from slapshot.errors import InputError
from slapshot.recordings.cli import format_warnings
from slapshot.recordings.data_quality import quality_warnings
from slapshot.recordings.format import Recording
from slapshot.recordings.read import read_recording
from slapshot.recordings.signal_quality import signal_warnings
from slapshot.recordings.signal_statistics import all_channel_statistics
from slapshot.recordings.signals import SignalRecording, read_signals, write_signals
from slapshot.recordings.summary import describe_hits, describe_signals
from slapshot.recordings.write import write_recording

from .builder import make_recording
from .signal_builder import make_signals
from .slide_tracks import recording_of, varied_slides

CASES = 200
Change = Callable[[pd.Series, np.random.Generator], pd.Series]

CHANGES: dict[str, Change] = {
    "scale": lambda v, rng: v * 10.0 ** rng.integers(-12, 13),
    "scale a little": lambda v, rng: v * rng.uniform(-2, 2),
    "shift": lambda v, rng: v + rng.choice([-1e6, -10, -1, 1e-9, 1, 10, 1e6]),
    "one value": lambda v, rng: v * 0 + rng.choice([0.0, 1.0, -3.0]),
    "shuffle": lambda v, rng: pd.Series(rng.permutation(list(v)), v.index),
    "reverse": lambda v, rng: pd.Series(v.to_numpy()[::-1], v.index),
    "round": lambda v, rng: v.round(rng.integers(0, 4)),
    "noise": lambda v, rng: v + rng.normal(0, 10.0 ** rng.integers(-6, 2), len(v)),
    "lose": lambda v, rng: v.where(rng.random(len(v)) > rng.choice([0.05, 0.9])),
    "outliers": lambda v, rng: v.where(rng.random(len(v)) > 0.02, rng.choice([-1e5, 99.0, 1e300, 1e-300])),
    "step": lambda v, rng: v + (np.arange(len(v)) > len(v) * rng.random()) * rng.normal(0, 5),
    "absolute": lambda v, rng: v.abs(),
}


def changed(frame: pd.DataFrame, rng: np.random.Generator, of: str = "hit") -> pd.DataFrame:
    """One to three changes of columns or rows, of all hits (or episodes) or of one."""
    frame = frame.copy()
    for _ in range(rng.integers(1, 4)):
        if rng.random() < 0.25:
            keep = np.sort(
                rng.choice(len(frame), max(1, int(len(frame) * rng.random())), replace=rng.random() < 0.3)
            )
            frame = frame.iloc[keep].reset_index(drop=True)
            continue
        numeric = [name for name in frame if name not in {"object_id", "recorded_at", "latent"}]
        column = str(rng.choice(numeric))
        rows = frame[of] == rng.choice(frame[of]) if rng.random() < 0.5 else np.ones(len(frame), bool)
        change = CHANGES[str(rng.choice(list(CHANGES)))]
        values = pd.Series(frame[column].astype("Float64").to_numpy(float, na_value=np.nan))
        frame[column] = values.where(~rows, change(values[rows], rng).reindex(frame.index))
    return frame


def fuzzed(seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    good = make_recording(seed) if rng.random() < 0.4 else recording_of(varied_slides(12))
    names = [name for name in ("hits", "tracks", "commands", "joints") if getattr(good, name) is not None]
    chosen = rng.choice(names, rng.integers(1, 3))
    return dataclasses.replace(good, **{str(name): changed(getattr(good, name), rng) for name in chosen})


@pytest.mark.parametrize("first", range(0, CASES, 25))
def test_a_changed_recording_is_refused_in_one_line_or_described(tmp_path: Path, first: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for seed in range(first, first + 25):
            try:
                write_recording(fuzzed(seed), tmp_path / str(seed))
                recording = read_recording(tmp_path / str(seed))
                said = f"{describe_hits(recording)}\n{format_warnings(quality_warnings(recording))}"
            except InputError as error:
                said = str(error)
            assert said.replace("\n", " ").isprintable(), (seed, said)
            assert ("\n" in said) == (tmp_path / str(seed)).exists(), (seed, said)
            assert not {" nan", " inf"} & set(re.findall(r" -?(?:nan|inf)\b", said)), (seed, said)


def fuzzed_signals(seed: int) -> SignalRecording:
    rng = np.random.default_rng(seed)
    good = make_signals(seed, seconds=float(rng.choice([0.1, 0.5, 2.0])))
    tables = {"episodes": good.episodes, **good.signals}
    for name in rng.choice(list(tables), rng.integers(1, 3)):
        tables[str(name)] = changed(tables[str(name)], rng, "episode")
    return dataclasses.replace(good, episodes=tables.pop("episodes"), signals=tables)


@pytest.mark.parametrize("first", range(0, CASES, 25))
def test_changed_signals_are_refused_in_one_line_or_described(tmp_path: Path, first: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for seed in range(first, first + 25):
            try:
                write_signals(fuzzed_signals(seed), tmp_path / str(seed))
                recording = read_signals(tmp_path / str(seed))
                channels = all_channel_statistics(recording)
                odd = format_warnings(signal_warnings(recording, channels))
                said = f"{describe_signals(recording, channels)}\n{odd}"
            except InputError as error:
                said = str(error)
            assert said.replace("\n", " ").isprintable(), (seed, said)
            assert ("\n" in said) == (tmp_path / str(seed)).exists(), (seed, said)
            assert not {" nan", " inf"} & set(re.findall(r" -?(?:nan|inf)\b", said)), (seed, said)
