import shutil
from pathlib import Path

import pytest
from slapshot.recordings.write import write_recording

from .builder import make_recording


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a small valid recording."""
    folder = tmp_path_factory.mktemp("whole") / "recording"
    write_recording(make_recording(), folder)
    return folder


@pytest.fixture
def folder(tmp_path: Path, whole: Path) -> Path:
    """A copy of it, which a test may break."""
    return Path(shutil.copytree(whole, tmp_path / "recording"))
