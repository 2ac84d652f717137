"""Freed memory stays with the process, so that the next array needs no new pages."""

import platform
import subprocess
import sys

import pytest

BLOCK = 64 * 2**20

FAULTS = f"""
import resource, sys
import numpy as np
from slapshot.memory import keep_freed_memory

if sys.argv[1] == "kept":
    keep_freed_memory()
for _ in range(2):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    np.ones({BLOCK} // 8)
    faults = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
print(faults)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc has mallopt")
def test_the_second_of_two_equal_arrays_needs_no_new_pages():
    """Of 64 MiB: pages of 4 KiB, or of up to 2 MiB where the system has large ones."""
    found = {
        how: int(subprocess.run([sys.executable, "-c", FAULTS, how], capture_output=True, check=True).stdout)
        for how in ("kept", "plain")
    }
    assert found["plain"] >= BLOCK / 2**21
    assert found["kept"] < BLOCK / 2**21 / 4
