"""Output files of a diagnosis of joints and bodies: the verdict first, then figures and models."""

import logging
import tempfile
import traceback
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import ModuleType

from slapshot.diagnosis.augmented import write_augmented
from slapshot.diagnosis.diagnose import Diagnosis
from slapshot.diagnosis.report import (
    candidate_figure,
    error_figure,
    prediction_figure,
    residual_figure,
)
from slapshot.diagnosis.report.markdown import AUGMENTED, VERDICT_TEXT, markdown
from slapshot.diagnosis.report.outcome import Outcome
from slapshot.diagnosis.report.rerun_recording import RECORDING_FILE, write_recording
from slapshot.diagnosis.verdict import Verdict, write_verdict
from slapshot.errors import InputError
from slapshot.plotting import save, use_style
from slapshot.recordings.signals import SignalRecording
from slapshot.text import reason_of
from slapshot.whole_file import write_whole

log = logging.getLogger("slapshot")

FIGURES: tuple[ModuleType, ...] = (prediction_figure, residual_figure, error_figure, candidate_figure)


def write_outputs(
    diagnosis: Diagnosis, verdict: Verdict, recording: SignalRecording, folder: Path
) -> tuple[str, ...]:
    """Write verdict.json, verdict.md, figures, recording.rrd, and augmented/ where something was named.

    The verdict is written first; what fails after it costs nothing else.

    Args:
        diagnosis: of the recording.
        verdict: the same, with versions.
        recording: that was diagnosed.
        folder: that exists.

    Returns:
        What could not be written and why, a line each.
    """
    write_verdict(verdict, folder)
    write_whole(folder / VERDICT_TEXT, markdown(verdict))
    problems: list[str] = []
    outcome = Outcome.of(diagnosis, verdict, recording)
    if outcome is None:
        return ()
    use_style()
    captions: dict[str, str] = {}
    augmented = False
    for name, caption, write in _parts(outcome):
        try:
            with tempfile.TemporaryDirectory(prefix=".drawing-", dir=folder) as aside:
                write(Path(aside))
                for file in sorted(Path(aside).iterdir()):
                    file.rename(folder / file.name)
        except Exception as error:  # a verdict that took minutes is not lost for a figure
            log.debug("%s", traceback.format_exc())
            kind = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
            problems.append(f"{name} could not be written ({kind}{reason_of(error)})")
            continue
        if caption is not None:
            captions[name] = caption
        augmented = augmented or name == AUGMENTED
    write_whole(folder / VERDICT_TEXT, markdown(verdict, captions, augmented=augmented, problems=problems))
    return tuple(problems)


def _parts(outcome: Outcome) -> Iterator[tuple[str, str | None, Callable[[Path], None]]]:
    """Name, caption and what writes into a folder; no caption for what is no figure."""
    for module in FIGURES:
        yield module.NAME, module.CAPTION, partial(_draw, module, outcome)
    yield RECORDING_FILE, None, partial(write_recording, outcome, markdown(outcome.verdict))
    if outcome.verdict.effects:
        yield AUGMENTED, None, partial(_augment, outcome)


def _draw(module: ModuleType, outcome: Outcome, folder: Path) -> None:
    save(module.draw(outcome), folder)


def _augment(outcome: Outcome, folder: Path) -> None:
    fit = outcome.search.final.scored.fit
    hypothesis = fit.hypothesis
    write_augmented(hypothesis.rig, hypothesis.effects, fit.theta, folder / AUGMENTED)
