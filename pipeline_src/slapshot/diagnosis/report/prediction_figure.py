"""J1: held-out windows, recorded and predicted, with what noise alone leaves."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from slapshot.diagnosis.report.outcome import Outcome
from slapshot.diagnosis.report.presentation import (
    MODEL_COLOURS,
    MODELS,
    NOISE,
    RECORDED,
    Z90,
    mark_stand_in,
    plain,
    scaled,
)
from slapshot.plotting import Drawing

NAME = "J1-predictions"
CAPTION = (
    "Held-out windows, predicted from the data before them and the recorded controls: above the "
    "motion, below recorded less predicted, less what the data before say of coloured noise. Columns are "
    "windows from the nominal model's lower quartile of errors to its largest; above each stands the nominal "
    "model's rms error. Shaded: 90 % of errors that noise alone would make of the best model. Of many "
    "channels those are shown whose errors are largest for their noise."
)
_QUANTILES = (0.25, 0.5, 0.75, 1.0)  # of windows, by the nominal model's error
_MAX_SHOWN = 4  # channels
_STYLES = {"nominal": "--", "refitted": ":", "augmented": "-"}


def draw(outcome: Outcome) -> Drawing:
    """Two rows a channel, a column a window."""
    channels = _channels(outcome)
    chosen = {c: _windows(outcome, c) for c in channels}
    columns = max(len(windows) for windows in chosen.values())
    figure, grid = plt.subplots(
        2 * len(channels), columns, figsize=(10.5, 0.55 + 2.75 * len(channels)), squeeze=False,
        height_ratios=[1.25, 1.0] * len(channels),
    )  # fmt: skip
    tables = []
    for row, channel in enumerate(channels):
        above, below = grid[2 * row], grid[2 * row + 1]
        table = _table(outcome, channel, chosen[channel])
        unit = table["unit"].iloc[0]
        largest = float(np.nanmax(np.abs(table["error"])))
        readable, factor = scaled(plain(unit), largest)
        limit = 1.08 * factor * largest
        for k, (window, error) in enumerate(chosen[channel].items()):
            own = table[table["window"] == window]
            _draw_motion(above[k], own)
            _draw_error(below[k], own, factor)
            below[k].set_ylim(-limit, limit)
            size = f"{factor * error:.3g} {readable}".rstrip()
            said = f"episode {own['episode'].iloc[0]}, {size}"
            above[k].set_title(said, loc="left", fontsize=8)
            above[k].tick_params(labelbottom=False)
            above[k].sharex(below[k])
            if k:
                below[k].tick_params(labelleft=False)
            if row == len(channels) - 1:
                below[k].set_xlabel("time in the episode (s)")
        for axes in [*above[len(chosen[channel]) :], *below[len(chosen[channel]) :]]:
            axes.set_axis_off()
        name = outcome.rig.observations[channel].channel
        above[0].set_ylabel(f"{name}\n({unit})" if plain(unit) else name)
        below[0].set_ylabel("recorded less\npredicted" + (f" ({readable})" if readable else ""))
        tables.append(table)
    figure.align_ylabels(grid[:, 0])
    handles, labels = grid[0, 0].get_legend_handles_labels()
    more, names = grid[1, 0].get_legend_handles_labels()
    figure.legend([*handles, *more], [*labels, *names], loc="outside lower center", ncols=5)
    mark_stand_in(figure, outcome.verdict)
    return Drawing(NAME, figure, pd.concat(tables, ignore_index=True))


def _channels(outcome: Outcome) -> list[int]:
    """Positions, or whatever is recorded without them; the worst of many for their noise, in order."""
    observations = outcome.rig.observations
    error = outcome.predictions("nominal").error
    seen = [c for c in range(len(observations)) if np.isfinite(error[..., c]).any()]
    shown = [c for c in seen if observations[c].quantity == "position"] or seen
    floor = outcome.predictions(outcome.best).floor
    ratio = {c: float(np.sqrt(np.nanmean((error[..., c] / floor[..., c]) ** 2))) for c in shown}
    return sorted(sorted(shown, key=lambda c: -ratio[c])[:_MAX_SHOWN])


def _windows(outcome: Outcome, channel: int) -> dict[int, float]:
    """Windows by how well the nominal model predicts them -> its rms error."""
    error = outcome.predictions("nominal").error[..., channel]
    there = np.flatnonzero(np.isfinite(error).any(1))
    rms = np.sqrt(np.nanmean(error[there] ** 2, axis=1))
    order = np.argsort(rms)
    some = dict.fromkeys(order[round(quantile * (len(order) - 1))] for quantile in _QUANTILES)
    return {int(there[k]): float(rms[k]) for k in some}


def _table(outcome: Outcome, channel: int, windows: dict[int, float]) -> pd.DataFrame:
    """A row a model and node, in SI units."""
    tables = []
    segments, half = outcome.windows, outcome.half
    floor = outcome.predictions(outcome.best).floor
    for window in windows:
        for model_name in outcome.by_model:
            tables.append(
                pd.DataFrame(
                    {
                        "channel": outcome.rig.observations[channel].channel,
                        "unit": outcome.units[channel],
                        "window": window,
                        "episode": int(segments.ids[segments.episode[window]]),
                        "t": segments.time[window, half:],
                        "recorded": outcome.recorded[window, :, channel],
                        "model": model_name,
                        "predicted": outcome.predictions(model_name).predicted[window, :, channel],
                        "error": outcome.predictions(model_name).error[window, :, channel],
                        "noise_sd": floor[window, :, channel],
                    }
                )
            )
    return pd.concat(tables, ignore_index=True)


def _draw_motion(axes: Axes, table: pd.DataFrame) -> None:
    first = table[table["model"] == table["model"].iloc[0]]
    axes.plot(first["t"], first["recorded"], color=RECORDED, lw=3.6, alpha=0.45, label="recorded")
    for model_name, rows in table.groupby("model", sort=False):
        axes.plot(
            rows["t"],
            rows["predicted"],
            _STYLES[str(model_name)],
            color=MODEL_COLOURS[str(model_name)],
            lw=1.5,
            label=MODELS[str(model_name)],
        )


def _draw_error(axes: Axes, table: pd.DataFrame, factor: float) -> None:
    first = table[table["model"] == table["model"].iloc[0]]
    band = factor * Z90 * first["noise_sd"]
    axes.fill_between(first["t"], -band, band, color=NOISE, lw=1.2, label="noise alone (90 %)")
    axes.axhline(0, color="black", lw=0.6)
    for model_name, rows in table.groupby("model", sort=False):
        axes.plot(
            rows["t"],
            factor * rows["error"],
            _STYLES[str(model_name)],
            color=MODEL_COLOURS[str(model_name)],
            lw=1.4,
        )
