import shutil
import subprocess

import pytest

NAMESPACE = ("unshare", "--user", "--map-root-user", "--mount")


@pytest.fixture(scope="session")
def namespace() -> tuple[str, ...]:
    """Start of a command that may mount file systems which only it and its children see."""
    if shutil.which("unshare") is None:
        pytest.skip("no unshare here: a disk that is full or read-only cannot be made")
    trial = (*NAMESPACE, "mount", "-t", "tmpfs", "tmpfs", "/mnt")
    done = subprocess.run(trial, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"users may not mount here ({done.stderr.strip()}): no disk that is full or read-only")
    return NAMESPACE
