"""J2: misfit of the model, for each joint over time, and over the variable of the mismatch."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from slapshot.diagnosis.report.outcome import Coordinate, Outcome, coordinates
from slapshot.diagnosis.report.presentation import (
    AUGMENTED,
    MODEL_COLOURS,
    MODELS,
    mark_stand_in,
    quantity,
    scaled,
)
from slapshot.diagnosis.report.residuals import Misfit, added_force, by_variable, misfit, variables
from slapshot.plotting import Drawing

NAME = "J2-residuals"
CAPTION = (
    "What the model misses along the motions that took part in fitting: the force that a smoother needs to "
    "make it follow the recording, or the error of the readings that is left without one; errors of the "
    "model's time step are taken out. Means over bins with 90 % intervals from the spread between half "
    "seconds, or without intervals where no three of these meet in a bin. Left: joint by joint in the "
    "course of the episode. Right: over the variable that the mismatch follows (over velocity where nothing "
    "is missing); pale thick line: the force that was found."
)
_MAX_SHOWN = 8  # joints that are shown
_AXIS = {
    "position": ("position of {name} ({unit})", "{unit}"),
    "velocity": ("velocity of {name} ({unit}/s)", "{unit}"),
    "load": ("torque of the actuator of {name} ({force})", "{force}"),
    "time": ("time since the episode began (s)", "s"),
    "session": ("course of the session, from its first episode (−0.5) to its last (0.5)", "1"),
}
_MARKS = {"nominal": "o", "refitted": "s", "augmented": "D"}


def draw(outcome: Outcome) -> Drawing:
    """Small panels over time, a large one over the variable."""
    shown = coordinates(outcome.rig.model)
    misfits = {model_name: misfit(outcome, model_name) for model_name in outcome.by_model}
    place, variable, column = _located(outcome, shown, misfits[next(iter(misfits))])
    shown = _chosen(shown, place, misfits[next(iter(misfits))])
    columns = 1 if len(shown) <= 4 else 2
    rows = -(-len(shown) // columns)
    figure = plt.figure(figsize=(10.5, max(3.4, 1.45 * rows + 0.7)))
    grid = figure.add_gridspec(rows, columns + 2, width_ratios=[1.0] * columns + [0.9, 0.9])
    tables = []
    first: Axes | None = None
    for k, coordinate in enumerate(shown):
        row, side = k % rows, k // rows
        axes = figure.add_subplot(grid[row, side], sharex=first)
        first = first or axes
        table = _over(outcome, coordinate, "time", misfits, None)
        _draw(axes, table, coordinate.force, small=True)
        axes.set_title(coordinate.name, loc="left", fontsize=8, pad=2)
        last = row == rows - 1 or k == len(shown) - 1
        axes.tick_params(labelbottom=last)
        if last:
            axes.set_xlabel("time in the episode (s)")
        tables.append(table.assign(part=coordinate.name, variable="time", unit=coordinate.force))
    axes = figure.add_subplot(grid[:, columns:])
    table = _over(outcome, place, variable, misfits, column)
    unit = coordinate_unit = place.force
    if column is not None:
        unit = coordinate_unit = place.motion
    added = added_force(outcome) if column is None else None
    if added is not None:
        law = replace(misfits["nominal"], force=added)
        extra = _over(outcome, place, variable, {"found": law}, None)
        table = pd.concat([extra, table], ignore_index=True)
    readable = _draw(axes, table, unit, small=False)
    label, _ = _AXIS[variable]
    axes.set_xlabel(label.format(name=place.name, unit=place.motion, force=place.force))
    what = (
        "error of its readings"
        if column is not None
        else "missing force"
        if place.force == "N"
        else "missing torque"
    )
    torque = float(outcome.search.nominal.problem.torque[place.v])
    drive = "" if column is not None else f"; {quantity(torque, place.force)} rms move it"
    axes.set_title(f"{place.name}: {what}{drive}", loc="left")
    axes.set_ylabel(f"{what} ({readable})")
    if len(table):
        axes.legend(loc="best")
    tables.append(table.assign(part=place.name, variable=variable, unit=coordinate_unit))
    force = {c.force for c in shown}
    figure.supylabel("missing torque" if force == {"N m"} else "missing force", fontsize=9)
    mark_stand_in(figure, outcome.verdict)
    return Drawing(NAME, figure, pd.concat(tables, ignore_index=True))


def _located(outcome: Outcome, shown: list[Coordinate], misfit: Misfit) -> tuple[Coordinate, str, int | None]:
    """Which coordinate and variable the verdict says, and the column of the readings if those are off.

    Where it says neither, the coordinate that lacks most for its torque, over its velocity.
    """
    scale = outcome.search.nominal.problem.torque[[c.v for c in shown]]
    size = np.sqrt(np.mean(misfit.force**2, axis=0)) / scale
    place, variable, column = shown[int(np.argmax(size))], "velocity", None
    location = outcome.verdict.location
    if location is None:
        return place, variable, column
    own = [c for c in shown if location.part in (c.name, c.joint)]
    if own:
        place = own[0] if len(own) == 1 else max(own, key=lambda c: float(size[shown.index(c)]))
    if location.follows in _AXIS and location.follows in variables(outcome, place):
        variable = location.follows
    if own and location.size is not None and location.size.unit == place.motion:
        read = [
            c
            for c, o in enumerate(outcome.rig.observations)
            if o.dof is not None and o.part == place.joint and o.quantity == "position"
        ]
        column = read[0] if read else None
    return place, variable, column


def _chosen(shown: list[Coordinate], place: Coordinate, misfit: Misfit) -> list[Coordinate]:
    """At most so many as can be seen: the one that is meant, and those that lack most, in order."""
    size = np.sqrt(np.mean(misfit.force**2, axis=0))
    best = sorted(range(len(shown)), key=lambda k: (shown[k] is not place, -size[k]))[:_MAX_SHOWN]
    return [shown[k] for k in sorted(best)]


def _over(
    outcome: Outcome, coordinate: Coordinate, variable: str, misfits: dict[str, Misfit], column: int | None
) -> pd.DataFrame:
    index = [c.v for c in coordinates(outcome.rig.model)].index(coordinate.v)

    def of(misfit: Misfit) -> np.ndarray:
        return misfit.force[:, index] if column is None else misfit.reading[:, column]

    return by_variable(outcome, coordinate, variable, of, misfits)


def _draw(axes: Axes, table: pd.DataFrame, unit: str, *, small: bool) -> str:
    """Points with intervals, a colour a model; returns the unit."""
    size = float(np.nanmax(np.abs(table[["value", "low", "high"]].to_numpy()), initial=0.0))
    readable, factor = scaled(unit, size)
    axes.axhline(0, color="black", lw=0.8)
    for model_name, rows in table.groupby("model", sort=False):
        colour = MODEL_COLOURS.get(str(model_name), AUGMENTED)
        value, low, high = (factor * rows[name].to_numpy() for name in ("value", "low", "high"))
        at = rows["at"].to_numpy()
        if model_name == "found":
            axes.plot(at, value, color=AUGMENTED, lw=5, alpha=0.3, label="what was found, as a force")
            continue
        axes.fill_between(at, low, high, color=colour, alpha=0.22, lw=0)
        axes.plot(
            at, value, color=colour, marker=_MARKS[str(model_name)], ms=2.5 if small else 4.5,
            lw=1.0 if small else 1.4, label=MODELS[str(model_name)],
        )  # fmt: skip
    if small:
        axes.set_ylabel(readable, fontsize=8)
        axes.tick_params(labelsize=7)
        axes.locator_params(axis="y", nbins=3)
    return readable
