"""What a person sees of a diagnosis: verdict.json and .md, figures with their tables, a Rerun recording."""

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

from slapshot.diagnosis.report import errors_figure, location_map, ranking, rests_figure, tracks_figure
from slapshot.diagnosis.report.outcome import Outcome, RestOutcome
from slapshot.diagnosis.report.rerun_recording import write_recording
from slapshot.diagnosis.report.sentences import VERDICT_TEXT, markdown
from slapshot.diagnosis.report.terminal import terminal_text
from slapshot.diagnosis.result import Diagnosis
from slapshot.diagnosis.verdict_file import read_verdict, write_verdict
from slapshot.figures.drawing import save, use_style

FIGURES: tuple[ModuleType, ...] = (location_map, ranking, tracks_figure, errors_figure)
REST_FIGURES: tuple[ModuleType, ...] = (rests_figure, ranking, errors_figure)


def write_report(diagnosis: Diagnosis, versions: Mapping[str, str], folder: Path) -> None:
    """Write all there is to see: of rest points no Rerun recording, and where nothing can be told no figures.

    Args:
        diagnosis: of one recording.
        versions: of scene, code and recording.
        folder: that exists.
    """
    write_verdict(diagnosis.verdict, versions, folder)
    outcome = Outcome.of(diagnosis)
    captions: dict[str, str] = {}
    if outcome is not None:
        captions = _draw(FIGURES, outcome, folder)
        write_recording(outcome, markdown(diagnosis.verdict), folder)
    elif diagnosis.rests is not None:
        captions = _draw(REST_FIGURES, RestOutcome(diagnosis.verdict, diagnosis.rests), folder)
    (folder / VERDICT_TEXT).write_text(markdown(diagnosis.verdict, versions, captions))


def _draw(modules: tuple[ModuleType, ...], outcome: Outcome | RestOutcome, folder: Path) -> dict[str, str]:
    """Save the figures; name -> caption."""
    use_style()
    for module in modules:
        save(module.draw(outcome), folder)
    return {module.NAME: module.CAPTION for module in modules}


__all__ = ["FIGURES", "REST_FIGURES", "read_verdict", "terminal_text", "write_report", "write_verdict"]
