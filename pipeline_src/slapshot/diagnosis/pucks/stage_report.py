"""Stage `diagnosis`: diagnose a recording that the configuration names, and write the whole report."""

import logging
from importlib.metadata import version

from slapshot.command import Run, stage_command
from slapshot.config.cases import DiagnosisSettings
from slapshot.diagnosis.pucks.diagnose import diagnose
from slapshot.diagnosis.pucks.outputs import write_outputs
from slapshot.diagnosis.pucks.report import terminal_text
from slapshot.diagnosis.pucks.rig_file import setting_of
from slapshot.effects.catalogue import import_effects
from slapshot.recordings.read import read_recording, recording_folders
from slapshot.scenes.scene import Scene

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write the report, refit.json, and augmented/ where something is missing."""
    settings = run.settings(DiagnosisSettings)
    scene = Scene.load(run.inputs["scene"])
    import_effects(*settings.effects)
    (folder,) = recording_folders(settings.recordings, run.inputs).values()
    setting = setting_of(scene, settings.friction)
    recording = read_recording(folder)
    found = diagnose(recording, setting, settings.seed, threads=run.cores)
    versions = {"slapshot": version("slapshot"), **{role: path.name for role, path in run.inputs.items()}}
    for problem in write_outputs(found, recording, scene, versions, run.out):
        log.warning("%s", problem)
    for line in terminal_text(found.verdict).splitlines():
        log.info("%s", line)


if __name__ == "__main__":
    stage_command("diagnosis", produce)
