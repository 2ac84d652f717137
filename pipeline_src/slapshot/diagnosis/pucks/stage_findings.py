"""Stage `findings`: diagnose a recording for those who build on what was found; no report.

Apart from the stage that writes the report, so that another figure does not train models again.
"""

from importlib.metadata import version

from slapshot.command import Run, stage_command
from slapshot.config.cases import DiagnosisSettings
from slapshot.diagnosis.pucks.augmented import AUGMENTED, write_augmented
from slapshot.diagnosis.pucks.diagnose import diagnose
from slapshot.diagnosis.pucks.refit import write_refit
from slapshot.diagnosis.pucks.rig_file import setting_of
from slapshot.diagnosis.pucks.verdict_file import write_verdict
from slapshot.effects.catalogue import import_effects
from slapshot.recordings.read import read_recording, recording_folders
from slapshot.scenes.scene import Scene


def produce(run: Run) -> None:
    """Write verdict.json, refit.json, and augmented/ where something is missing."""
    settings = run.settings(DiagnosisSettings)
    scene = Scene.load(run.inputs["scene"])
    import_effects(*settings.effects)
    (folder,) = recording_folders(settings.recordings, run.inputs).values()
    recording = read_recording(folder)
    found = diagnose(recording, setting_of(scene, settings.friction), settings.seed, threads=run.cores)
    versions = {"slapshot": version("slapshot"), **{role: path.name for role, path in run.inputs.items()}}
    write_verdict(found.verdict, versions, run.out)
    write_refit(found, recording, run.out)
    if found.values():
        write_augmented(scene, found.values(), run.out / AUGMENTED)


if __name__ == "__main__":
    stage_command("findings", produce)
