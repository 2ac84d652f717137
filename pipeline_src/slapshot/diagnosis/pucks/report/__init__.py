"""What a person sees of a diagnosis: verdict.json and .md, figures with their tables, a Rerun recording."""

import logging
import tempfile
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType

from slapshot.diagnosis.pucks.report import (
    errors_figure,
    hits_figure,
    location_map,
    ranking,
    rests_figure,
    tracks_figure,
)
from slapshot.diagnosis.pucks.report.outcome import Outcome, RestOutcome
from slapshot.diagnosis.pucks.report.rerun_recording import RECORDING_FILE, write_recording
from slapshot.diagnosis.pucks.report.sentences import VERDICT_TEXT, markdown
from slapshot.diagnosis.pucks.report.terminal import terminal_text
from slapshot.diagnosis.pucks.result import Diagnosis
from slapshot.diagnosis.pucks.verdict import Verdict
from slapshot.diagnosis.pucks.verdict_file import read_verdict, write_verdict
from slapshot.plotting import save, use_style
from slapshot.text import reason_of
from slapshot.whole_file import write_whole

log = logging.getLogger("slapshot")

FIGURES: tuple[ModuleType, ...] = (location_map, ranking, tracks_figure, errors_figure)
REST_FIGURES: tuple[ModuleType, ...] = (rests_figure, ranking, errors_figure)


def write_report(diagnosis: Diagnosis, versions: Mapping[str, str], folder: Path) -> tuple[str, ...]:
    """Write all there is to see: of rest points no Rerun recording, where nothing can be told the hits alone.

    The verdict is written first. A figure that fails is named in its notes, and costs nothing else.

    Args:
        diagnosis: of one recording.
        versions: of scene, code and recording.
        folder: that exists.

    Returns:
        What could not be drawn and why, a line each.
    """
    verdict = diagnosis.verdict
    _write_verdict(verdict, versions, {}, folder)
    captions: dict[str, str] = {}
    problems: list[str] = []
    for name, caption, draw in _drawings(diagnosis):
        try:
            with tempfile.TemporaryDirectory(prefix=".drawing-", dir=folder) as aside:
                draw(Path(aside))
                for file in sorted(Path(aside).iterdir()):
                    file.rename(folder / file.name)
        except Exception as error:  # a verdict that took minutes is not lost for a figure
            log.debug("%s", traceback.format_exc())
            problems.append(f"{name} could not be drawn ({type(error).__name__}: {reason_of(error)})")
        else:
            if caption is not None:
                captions[name] = caption
    notes = (*verdict.notes, *problems)
    _write_verdict(replace(verdict, notes=notes), versions, captions, folder)
    return tuple(problems)


def _write_verdict(
    verdict: Verdict, versions: Mapping[str, str], captions: Mapping[str, str], folder: Path
) -> None:
    write_verdict(verdict, versions, folder)
    write_whole(folder / VERDICT_TEXT, markdown(verdict, versions, captions))


def _drawings(diagnosis: Diagnosis) -> Iterator[tuple[str, str | None, Callable[[Path], None]]]:
    """Name, caption and what draws into a folder, of all that there is to see; no caption for no figure."""
    outcome = Outcome.of(diagnosis)
    shown: Outcome | RestOutcome | None = outcome
    if outcome is None and diagnosis.rests is not None:
        shown = RestOutcome(diagnosis.verdict, diagnosis.rests)
    use_style()
    if shown is None and hits_figure.can_be_drawn(diagnosis):
        yield hits_figure.NAME, hits_figure.CAPTION, lambda folder: save(hits_figure.draw(diagnosis), folder)
    if shown is None:
        return
    for module in FIGURES if outcome is not None else REST_FIGURES:
        yield module.NAME, module.CAPTION, partial(_draw, module, shown)
    if outcome is not None:
        yield RECORDING_FILE, None, partial(write_recording, outcome, markdown(diagnosis.verdict))


def _draw(module: ModuleType, outcome: Outcome | RestOutcome, folder: Path) -> None:
    save(module.draw(outcome), folder)


__all__ = ["FIGURES", "REST_FIGURES", "read_verdict", "terminal_text", "write_report", "write_verdict"]
