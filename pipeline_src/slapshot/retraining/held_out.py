"""Stage `held_out`: the hits of a recording that its diagnosis held out, as a recording of their own."""

import json
from dataclasses import replace

import pandas as pd

from slapshot.command import Run, stage_command
from slapshot.config.retraining import HeldOutSettings
from slapshot.diagnosis.pucks.refit import REFIT_FILE
from slapshot.errors import InputError
from slapshot.recordings.read import read_recording, recording_folders
from slapshot.recordings.write import write_recording


def produce(run: Run) -> None:
    """Write recording/, without tracks and encoders, which adaptation does not read.

    Raises:
        InputError: the diagnosis had insufficient data.
    """
    (folder,) = recording_folders(run.settings(HeldOutSettings).recordings, run.inputs).values()
    file = run.inputs["findings"] / REFIT_FILE
    if not file.is_file():
        raise InputError(f"{file.parent}: the diagnosis could not tell anything of {folder}")
    held = json.loads(file.read_text())["held_out"]
    whole = read_recording(folder)
    write_recording(
        replace(
            whole,
            hits=_of(whole.hits, held),
            tracks=None,
            joints=None,
            commands=None if whole.commands is None else _of(whole.commands, held),
        ),
        run.out / "recording",
    )


def _of(table: pd.DataFrame, hits: list[int]) -> pd.DataFrame:
    return table[table["hit"].isin(hits)].reset_index(drop=True)


if __name__ == "__main__":
    stage_command("held_out", produce)
