"""The benches, made once."""

from functools import cache

import pytest

from .rigs import BENCHES, Bench


@cache
def _made(name: str) -> Bench:
    return BENCHES[name]()


@pytest.fixture(params=BENCHES)
def any_bench(request) -> Bench:
    """Each of the benches."""
    return _made(request.param)
