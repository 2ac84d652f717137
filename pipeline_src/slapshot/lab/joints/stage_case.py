"""Stage `joint_case`: a recording of a stand-in rig with joints, its model, and apart from them the truth."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

from slapshot.command import Run, stage_command
from slapshot.json_types import JsonObject
from slapshot.lab.joints.case_spec import CaseSpec, JointCaseSettings
from slapshot.lab.joints.record_case import make
from slapshot.lab.joints.rigs import rig_named
from slapshot.recordings.signals import write_signals


def produce(run: Run) -> None:
    """Write recording/ (format 2), rig.yaml and model.xml, which it names, and sealed/truth.json."""
    record(run.settings(JointCaseSettings).spec, run.out)


def record(spec: CaseSpec, out: Path) -> JsonObject:
    """Make a case and write it into folder `out`, which exists; returns the truth.

    Raises:
        InputError: the case is not possible.
    """
    recording, truth = make(spec)
    text = (json.dumps(truth, indent=1, sort_keys=True) + "\n").encode()
    recording = replace(recording, sealed_truth_sha256=hashlib.sha256(text).hexdigest())
    (out / "sealed").mkdir()
    (out / "sealed" / "truth.json").write_bytes(text)
    (out / "model.xml").write_text(rig_named(spec.rig).xml)
    (out / "rig.yaml").write_text("model: model.xml\n")
    write_signals(recording, out / "recording")
    return truth


if __name__ == "__main__":
    stage_command("joint_case", produce)
