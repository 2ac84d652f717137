"""What a person sees of a diagnosis: verdict.json and .md, figures with their tables, a Rerun recording."""

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

from slapshot.diagnosis.report import errors_figure, location_map, ranking, tracks_figure
from slapshot.diagnosis.report.outcome import Outcome
from slapshot.diagnosis.report.rerun_recording import write_recording
from slapshot.diagnosis.report.sentences import VERDICT_TEXT, markdown
from slapshot.diagnosis.report.terminal import terminal_text
from slapshot.diagnosis.result import Diagnosis
from slapshot.diagnosis.verdict_file import read_verdict, write_verdict
from slapshot.figures.drawing import save, use_style

FIGURES: tuple[ModuleType, ...] = (location_map, ranking, tracks_figure, errors_figure)


def write_report(diagnosis: Diagnosis, versions: Mapping[str, str], folder: Path) -> None:
    """Write all there is to see; verdict.json and verdict.md alone where a recording cannot tell.

    Args:
        diagnosis: of one recording.
        versions: of scene, code and recording.
        folder: that exists.
    """
    write_verdict(diagnosis.verdict, versions, folder)
    outcome = Outcome.of(diagnosis)
    captions: dict[str, str] = {}
    if outcome is not None:
        use_style()
        for module in FIGURES:
            save(module.draw(outcome), folder)
            captions[module.NAME] = module.CAPTION
        write_recording(outcome, markdown(diagnosis.verdict), folder)
    (folder / VERDICT_TEXT).write_text(markdown(diagnosis.verdict, versions, captions))


__all__ = ["FIGURES", "read_verdict", "terminal_text", "write_report", "write_verdict"]
