"""Stage `verdict`: diagnose one recording, and keep what was found as verdict.json."""

from importlib.metadata import version

from slapshot.command import Run, stage_command
from slapshot.config.cases import VerdictSettings
from slapshot.diagnosis.pucks.diagnose import diagnose
from slapshot.diagnosis.pucks.launch.signatures import Signatures
from slapshot.diagnosis.pucks.rig_file import setting_of
from slapshot.diagnosis.pucks.verdict_file import write_verdict
from slapshot.effects.catalogue import import_effects
from slapshot.recordings.read import read_recording
from slapshot.scenes.scene import Scene


def produce(run: Run) -> None:
    """Write verdict.json; of the folder of the recording nothing but recording/ is read."""
    settings = run.settings(VerdictSettings)
    scene = Scene.load(run.inputs["scene"])
    import_effects(*settings.effects)
    setting = setting_of(scene, settings.friction)
    signatures = Signatures.load(run.inputs["signatures"] / "signatures.safetensors")
    recording = read_recording(run.inputs["recording"] / "recording")
    found = diagnose(recording, setting, settings.seed, threads=run.cores, signatures=signatures)
    versions = {"slapshot": version("slapshot"), **{role: path.name for role, path in run.inputs.items()}}
    write_verdict(found.verdict, versions, run.out)


if __name__ == "__main__":
    stage_command("verdict", produce)
