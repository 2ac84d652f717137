"""All that a diagnosis writes: the report, the scene with what was found, and what was fitted beside it."""

from collections.abc import Mapping
from pathlib import Path

from slapshot.diagnosis.pucks.augmented import AUGMENTED, write_augmented
from slapshot.diagnosis.pucks.refit import write_refit
from slapshot.diagnosis.pucks.report import write_report
from slapshot.diagnosis.pucks.result import Diagnosis
from slapshot.diagnosis.pucks.verdict_file import write_verdict
from slapshot.recordings.format import Recording
from slapshot.scenes.scene import Scene
from slapshot.whole_file import replacing


def write_outputs(
    diagnosis: Diagnosis, recording: Recording, scene: Scene, versions: Mapping[str, str], folder: Path
) -> tuple[str, ...]:
    """Write the report, refit.json, and augmented/ where something is missing.

    Args:
        diagnosis: of the recording.
        recording: that was diagnosed.
        scene: nominal.
        versions: of scene, code and recording.
        folder: that exists.

    Returns:
        What could not be drawn and why, a line each.
    """
    write_verdict(diagnosis.verdict, versions, folder)  # as soon as it is known
    write_refit(diagnosis, recording, folder)
    values = diagnosis.values()
    if values:
        with replacing(folder / AUGMENTED) as aside:
            write_augmented(scene, values, aside)
    return write_report(diagnosis, versions, folder)
