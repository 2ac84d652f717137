"""Stage `arms`: errors of the models of three arms on the diagnosed rig, as tables and figures."""

import json
from typing import Any

import numpy as np
import pandas as pd

from slapshot.command import Run, stage_command
from slapshot.config.retraining import ArmsSettings
from slapshot.latent_space import read_latents
from slapshot.parquet import read_frame
from slapshot.plotting import STAND_IN, save, use_style
from slapshot.recordings.read import read_recording, recording_folders
from slapshot.retraining import ARMS
from slapshot.retraining.compare import Measure, measures_of, noise_floor
from slapshot.retraining.figures import draw_errors, draw_latents

HITS = ("all hits", "hits held out from the diagnosis")


def produce(run: Run) -> None:
    """Write F8-<domain>-arms, F9-<domain>-arms, arms.csv and arms.md."""
    settings, inputs = run.settings(ArmsSettings), run.inputs
    (folder,) = recording_folders(settings.recordings, inputs).values()
    recording = read_recording(folder)
    held = json.loads((inputs["findings"] / "refit.json").read_text())["held_out"]
    errors = {
        hits: {arm: read_frame(inputs[f"errors/{role}/{arm}"] / "errors.parquet") for arm in ARMS}
        for hits, role in zip(HITS, ("all", "held_out"), strict=True)
    }
    # The scatter is estimated best from repeats among all hits; held-out hits end at other distances.
    whole, repeats = noise_floor(recording)
    floors = dict(zip(HITS, (whole, whole * _farther(recording.hits, held)), strict=True))
    rng = np.random.default_rng(settings.seed)
    measures = [m for hits in HITS for m in measures_of(errors[hits], floors[hits], hits, rng)]
    measures += [Measure("noise floor, m", hits, floors[hits], np.nan, np.nan, repeats) for hits in HITS]
    use_style()
    save(draw_errors(errors, floors, recording.stand_in, settings.domain), run.out)
    latents = {arm: read_latents(inputs[f"beliefs/{arm}"]) for arm in ARMS}
    drawing, distances = draw_latents(latents, settings.samples, recording.stand_in, settings.domain)
    save(drawing, run.out)
    measures += [
        Measure(
            f"distance from drawn conditions, {arm}", HITS[0], float(d), np.nan, np.nan, len(latents[arm])
        )
        for arm, d in zip(ARMS, distances, strict=True)
    ]
    table = pd.DataFrame(measures)
    table.to_csv(run.out / "arms.csv", index=False, float_format="%.4g")
    found = json.loads((inputs["findings"] / "verdict.json").read_text())
    ranges = json.loads((inputs["rollouts/refitted"] / "ranges.json").read_text())
    (run.out / "arms.md").write_text(_page(found, ranges, table, settings.domain, recording.stand_in))


def _farther(hits: pd.DataFrame, held: list[int]) -> float:
    """Mean distance of the held-out hits over that of all hits."""
    way = np.hypot(hits["rest_x"] - hits["start_x"], hits["rest_y"] - hits["start_y"])
    return float(way[hits["hit"].isin(held)].mean() / way.mean())


def _page(
    verdict: dict[str, Any], ranges: dict[str, Any], measures: pd.DataFrame, domain: str, stand_in: bool
) -> str:
    named = ", ".join(effect["name"].replace("_", " ") for effect in verdict["effects"]) or "nothing"
    kind = f", a **{STAND_IN}**" if stand_in else ""
    rows = [f"| {r.measure} | {r.condition} | {_value(r)} | {r.n} |" for r in measures.itertuples()]
    drawn = [f"| {name} | `{json.dumps(spec)}` |" for name, spec in ranges.items()]
    return "\n".join(
        [
            "# Closing the circle: what the diagnosis is worth to adaptation",
            "",
            f"Recording of “{verdict['rig']}”{kind}. The diagnosis named: {named}. Models of the same kind "
            "were trained on three sets of rollouts: the nominal scene with its ranges, the same scene with "
            "ranges about what the diagnosis fitted, and the scene with what was found in the same ranges.",
            "",
            f"![F8](F8-{domain}-arms.png)",
            "",
            "*Error against samples seen. Bands: 95 % intervals of the mean over models.*",
            "",
            f"![F9](F9-{domain}-arms.png)",
            "",
            "*Hidden states of one model an arm: conditions drawn in training and the recorded pucks. The "
            "distance is that of the recorded states from the drawn ones, in standard deviations.*",
            "",
            "| measure | on | value (95 % interval) | n |",
            "| --- | --- | --- | --- |",
            *rows,
            "",
            "Intervals of errors and shares: a bootstrap over random splits and models, arms together; the "
            "rig, its hits and its diagnosis are one draw. n counts splits, repeated hits or hidden states.",
            "",
            "| parameter | refitted range |",
            "| --- | --- |",
            *drawn,
            "",
        ]
    )


def _value(row: Any) -> str:
    if np.isnan(row.low):
        return f"{row.value:.3g}"
    return f"{row.value:.3g} ({row.low:.3g} to {row.high:.3g})"


if __name__ == "__main__":
    stage_command("arms", produce)
