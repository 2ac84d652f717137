from pathlib import Path

import pytest
from slapshot.recordings.write import write_recording

from .builder import make_recording


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Folder of a small valid recording, which a test may break."""
    folder = tmp_path / "recording"
    write_recording(make_recording(), folder)
    return folder
