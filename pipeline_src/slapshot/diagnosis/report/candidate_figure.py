"""J4: candidates and their evidence: all of them alone, then those that were refitted in each step."""

import textwrap

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from slapshot.diagnosis.report.outcome import Outcome
from slapshot.diagnosis.report.presentation import AUGMENTED, FREE_FORM, mark_stand_in
from slapshot.diagnosis.selection.free_forms import is_free
from slapshot.diagnosis.selection.steps import EQUIVALENCE_NATS, Step
from slapshot.effects.joints.effect import JointEffect
from slapshot.plotting import Drawing

NAME = "J4-candidates"
CAPTION = (
    "Evidence for single effects over the model before, in nats; first of all candidates alone by one linear "
    "screen of the nominal model, then of those that were refitted in each step of the search. Orange: free "
    "forms, which describe without naming. Dark: what the step added; middling: what is equivalent to it."
)
_MAX_SHOWN = 12
_ALIKE, _PALE = "#5AA2CF", "#B9D5E8"


def draw(outcome: Outcome) -> Drawing:
    """A panel for the screen, and one a step that refitted something."""
    steps = _steps(outcome)
    tables = [_screen(outcome.search.nominal), *(_refits(step) for step in steps)]
    titles = ["each alone, linear screen"] + [f"step {k}, refitted" for k in range(1, len(steps) + 1)]
    columns = min(2, len(tables))
    rows = -(-len(tables) // columns)
    heights = [
        max(len(tables[k]) for k in range(r * columns, min((r + 1) * columns, len(tables))))
        for r in range(rows)
    ]
    figure, grid = plt.subplots(
        rows, columns, figsize=(6.2 * columns, sum(0.75 + 0.21 * h for h in heights)), squeeze=False,
        height_ratios=[0.75 + 0.21 * h for h in heights],
    )  # fmt: skip
    for axes, table, title in zip(grid.flat, tables, titles, strict=False):
        _draw(axes, table)
        axes.set_title(title, loc="left")
    for axes in grid.flat[len(tables) :]:
        axes.set_axis_off()
    mark_stand_in(figure, outcome.verdict)
    panels = [table.assign(panel=title) for table, title in zip(tables, titles, strict=True)]
    return Drawing(NAME, figure, pd.concat(panels, ignore_index=True))


def _steps(outcome: Outcome) -> list[Step]:
    """Steps that refitted something; one that only removed effects has the refits of the one before."""
    found: list[Step] = []
    for step in outcome.search.steps:
        if step.rivals and not (found and found[-1].rivals is step.rivals):
            found.append(step)
    return found


def _screen(step: Step) -> pd.DataFrame:
    scored = step.scored
    found = scored.gains
    best: dict[str, tuple[float, bool]] = {}
    for effect, gain in zip(scored.effects, found, strict=True):
        name = _name(effect)
        best_so_far = best[name][0] if name in best else -np.inf
        if gain.log_evidence > best_so_far:  # several starts of one effect are one
            best[name] = (gain.log_evidence, is_free(effect))
    rows = [{"candidate": n, "nats": g, "free_form": f, "added": False} for n, (g, f) in best.items()]
    return pd.DataFrame(rows, columns=["candidate", "nats", "free_form", "added"]).nlargest(
        _MAX_SHOWN, "nats"
    )


def _refits(step: Step) -> pd.DataFrame:
    added = "" if step.added is None else step.added.key
    rows = [
        {"candidate": _name(r.effect), "nats": r.gain, "free_form": False, "added": r.effect.key == added}
        for r in step.rivals
    ]
    return pd.DataFrame(rows).nlargest(_MAX_SHOWN, "nats")


def _name(effect: JointEffect) -> str:
    phrase = effect.phrase.format(part=effect.part)
    if is_free(effect):
        return f"{phrase} {effect.variant}".strip()
    return f"{phrase} ({effect.variant})" if effect.variant else phrase


def _draw(axes: Axes, table: pd.DataFrame) -> None:
    places = range(len(table))[::-1]
    refitted = bool(table["added"].any())
    nats = table["nats"].to_numpy(float)
    best = float(nats[table["added"].to_numpy(bool)].max()) if refitted else -np.inf
    colours = [
        FREE_FORM if free
        else AUGMENTED if added or not refitted
        else _ALIKE if best - gain < EQUIVALENCE_NATS
        else _PALE
        for free, added, gain in zip(table["free_form"], table["added"], nats, strict=True)
    ]  # fmt: skip
    axes.barh(places, nats, height=0.62, color=colours, lw=0)
    for y, gain in zip(places, nats, strict=True):
        axes.annotate(
            f"{gain:.1f}".replace("-", "−"), (max(gain, 0), y), (3, 0), textcoords="offset points",
            va="center", fontsize=7,
        )  # fmt: skip
    axes.axvline(0, color="black", lw=0.8)
    low, high = min(float(nats.min()), 0.0), max(float(nats.max()), 1.0)
    axes.set_xlim(1.1 * low, low + 1.2 * (high - low))
    axes.set_yticks(places, [_short(name) for name in table["candidate"]], fontsize=7.5)
    axes.set_ylim(-0.7, max(len(table), 4) - 0.3)
    axes.locator_params(axis="x", nbins=4)
    axes.grid(axis="y", visible=False)
    over = "model before" if refitted else "nominal model"
    # A power of ten apart from the numbers would lie on the label.
    axes.ticklabel_format(axis="x", style="plain", useOffset=False)
    # It may be longer than the axis: to the left there is room, beneath the names.
    axes.set_xlabel(f"log evidence over the {over} (nats)", loc="right")


def _short(name: str) -> str:
    return "\n".join(textwrap.wrap(name, 66, max_lines=2, placeholder=" …"))
