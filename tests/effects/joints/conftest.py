"""The benches, made once."""

from functools import cache

import pytest

from .rigs import BENCHES, RigSimulator


@cache
def _made(name: str) -> RigSimulator:
    return BENCHES[name]()


@pytest.fixture(params=BENCHES)
def any_bench(request) -> RigSimulator:
    """Each of the benches."""
    return _made(request.param)
