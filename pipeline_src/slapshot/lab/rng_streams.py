"""Random streams selected by name, independent of all other draws."""

import zlib

import numpy as np


def stream_for(rng: np.random.Generator, name: str) -> np.random.Generator:
    """A separate stream for `name`; it depends on the seed of `rng`, not on what `rng` has drawn."""
    parent = rng.bit_generator.seed_seq
    assert isinstance(parent, np.random.SeedSequence)
    key = (*parent.spawn_key, zlib.crc32(name.encode()))
    return np.random.default_rng(np.random.SeedSequence(parent.entropy, spawn_key=key))


def recording_streams(seed: int | list[int]) -> list[np.random.Generator]:
    """Streams of a recording: for its rig, session, scale, hits and hidden effects."""
    return np.random.default_rng(seed).spawn(5)
