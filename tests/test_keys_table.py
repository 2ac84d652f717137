"""Tables of keys in the documentation."""

from pathlib import Path

import pytest
from slapshot.diagnosis.model.rig_file import RigSettings
from slapshot.keys_table import keys_table
from slapshot.recordings.importing.signal_mapping import SignalMapping

DOCS = Path(__file__).parents[1] / "docs"


@pytest.mark.parametrize(("model", "page"), [(SignalMapping, "recordings.md"), (RigSettings, "joints.md")])
def test_keys_in_the_documentation_are_those_of_the_code(model, page):
    assert keys_table(model) in (DOCS / page).read_text()
