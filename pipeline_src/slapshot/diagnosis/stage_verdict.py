"""Stage `joint_verdict`: diagnose one recording of joints, and keep what was found as verdict.json."""

from importlib.metadata import version

from slapshot.command import Run, stage_command
from slapshot.config.cases import JointVerdictSettings
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.model.rig_file import bound_rig, read_rig_file
from slapshot.diagnosis.verdict import versioned, write_verdict
from slapshot.recordings.signal_quality import quality_warning_lines
from slapshot.recordings.signals import read_signals


def produce(run: Run) -> None:
    """Write verdict.json; of the folder of the case only recording/, rig.yaml and its model are read."""
    case = run.inputs["case"]
    recording = read_signals(case / "recording")
    rig, recording = bound_rig(read_rig_file(case / "rig.yaml"), recording)
    found = diagnose(
        recording,
        rig,
        seed=run.settings(JointVerdictSettings).seed,
        threads=run.cores,
        findings=quality_warning_lines(recording),
    )
    write_verdict(versioned(found.verdict, {"slapshot": version("slapshot"), "case": case.name}), run.out)


if __name__ == "__main__":
    stage_command("joint_verdict", produce)
