"""What tests of the calibration share."""

import numba
import pytest


@pytest.fixture(autouse=True)
def one_numba_thread():
    """Systems this small only wait for a second thread, very long where another process has it."""
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(threads)
