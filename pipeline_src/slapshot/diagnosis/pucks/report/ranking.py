"""D2: all hypotheses, ranked by their evidence over the nominal scene with refitted friction."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator

from slapshot.diagnosis.pucks.report.outcome import Outcome, RestOutcome
from slapshot.diagnosis.pucks.report.style import AUGMENTED, mark_stand_in
from slapshot.diagnosis.pucks.report.wording import title
from slapshot.diagnosis.pucks.selection.level import LEAST_EVIDENCE
from slapshot.diagnosis.pucks.selection.search import CLASS
from slapshot.plotting import OTHER_COLOURS, Drawing

NAME = "D2-ranking"
CAPTION = (
    "Evidence for every hypothesis alone, over the nominal scene with friction refitted: small dots from one "
    "linear screen, diamonds where refitted with full nonlinearity. Stars mark effects that the verdict "
    "names, or cannot tell from one that it names; orange are free forms, which describe without naming. "
    "Where several were tried at once, (b) shows how far they, and the best alone, are behind the best of "
    "these; within the band they are not told apart."
)

FREE_COLOUR = OTHER_COLOURS[0]
LINEAR = 10.0  # nats up to which the axis is linear
CROWDED = 100.0  # nats: beyond, there is no room for a tick at 1
_TICKS = (-10, -3, -1, 0, 1, 3, 10, 30, 100, 300, 1000, 3000, 10000, 30000, 100000)
MOST_SETS = 8


def draw(outcome: Outcome | RestOutcome) -> Drawing:
    """Panel (a) single hypotheses; (b) sets of several effects, where any were tried."""
    table, sets = single_table(outcome), set_table(outcome)
    height = 1.8 + 0.19 * len(table)
    if len(sets):
        figure, (a, b) = plt.subplots(1, 2, figsize=(11.5, height), width_ratios=[1.2, 1])
        _draw_sets(b, sets)
        b.set_title("(b) several at once, and the best alone; dark: named", loc="left")
    else:
        figure, a = plt.subplots(figsize=(7.2, height))
    _draw_single(a, table)
    a.set_title("(a) each hypothesis alone" if len(sets) else "each hypothesis alone", loc="left")
    figure.legend(*a.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    mark_stand_in(figure, outcome.verdict)
    return Drawing(
        NAME, figure, pd.concat([table.assign(panel="a"), sets.assign(panel="b")], ignore_index=True)
    )


def single_table(outcome: Outcome | RestOutcome) -> pd.DataFrame:
    """A row a hypothesis, best first: evidence (nats) by the screen and refitted, the verdict's word."""
    rows = []
    for part in outcome.parts:
        named = [e for e in outcome.verdict.effects if e.name in part.final.effects]
        members = {n: (e.name, p) for e in named for n, p in e.members.items()}
        for name, evidence in part.screen.log_evidence.items():
            if name in part.search.unreached:
                continue
            effect, refitted = outcome.effect(name), part.search.seen.get((name,))
            of, probability = members.get(name, (None, np.nan))
            rows.append(
                {
                    "part": part.name,
                    "hypothesis": name,
                    "free_form": name in part.search.free,
                    "phase": effect.phase,
                    "variable": effect.follows,
                    "screen_nats": evidence,
                    "refitted_nats": np.nan if refitted is None else refitted.log_evidence,
                    "shift_m": part.screen.shift[name],
                    "class_of": of,
                    "probability": probability,
                }
            )
    table = pd.DataFrame(rows)
    best = table["refitted_nats"].fillna(table["screen_nats"])
    return table.assign(shown_nats=best).sort_values("shown_nats", ascending=False, ignore_index=True)


def set_table(outcome: Outcome | RestOutcome) -> pd.DataFrame:
    """The best sets of two or more effects that were refitted, and the best by itself, maybe a free form."""
    rows = []
    for part in outcome.parts:
        seen = part.search.seen
        several = sorted((s for s in seen if len(s) > 1), key=lambda s: -seen[s].log_evidence)[:MOST_SETS]
        if several:
            several.append(max((s for s in seen if len(s) == 1), key=lambda s: seen[s].log_evidence))
        rows += [
            {
                "part": part.name,
                "hypothesis": " + ".join(s),
                "refitted_nats": seen[s].log_evidence,
                "final": s == part.final.effects,
            }
            for s in several
        ]
    return pd.DataFrame(rows, columns=["part", "hypothesis", "refitted_nats", "final"])


def _draw_single(axes: Axes, table: pd.DataFrame) -> None:
    place = np.arange(len(table))[::-1]
    colours = np.where(table["free_form"], FREE_COLOUR, AUGMENTED)
    axes.hlines(place, 0, table["shown_nats"], color=colours, lw=1.2, alpha=0.5)
    axes.scatter(table["screen_nats"], place, s=14, color=colours, zorder=3)
    refitted = table["refitted_nats"].notna()
    axes.scatter(
        table["refitted_nats"][refitted], place[refitted], s=30, marker="D", color=colours[refitted], zorder=4
    )
    named = table["class_of"].notna()
    axes.scatter(
        np.full(named.sum(), 1.02), place[named], s=60, marker="*", color="black", clip_on=False,
        transform=axes.get_yaxis_transform(),
    )  # fmt: skip
    for probability, y in zip(table["probability"][named].astype(float), place[named], strict=True):
        axes.annotate(
            f"{100 * probability:.0f} %", (1.045, y), xycoords=("axes fraction", "data"), fontsize=7,
            va="center", annotation_clip=False,
        )  # fmt: skip
    several = len(set(table["part"])) > 1
    notes = table["part"] + ", " + table["variable"] if several else table["variable"]
    axes.set_yticks(place, [f"{title(h)} ({n})" for h, n in zip(table["hypothesis"], notes, strict=True)])
    for label, colour, marker, size, there in (
        ("effect, linear screen", AUGMENTED, "o", 14, True),
        ("effect, refitted", AUGMENTED, "D", 30, (refitted & ~table["free_form"]).any()),
        ("free form, linear screen", FREE_COLOUR, "o", 14, table["free_form"].any()),
        ("free form, refitted", FREE_COLOUR, "D", 30, (refitted & table["free_form"]).any()),
        ("named, or not told from it", "black", "*", 60, named.any()),
    ):
        if there:
            axes.scatter([], [], s=size, marker=marker, color=colour, label=label)
    _nats(axes, -np.inf if several else table["shown_nats"].max())
    axes.grid(axis="y", visible=False)


def _draw_sets(axes: Axes, sets: pd.DataFrame) -> None:
    """How far sets are behind the best one, which their evidence over the nominal scene would hide."""
    place = np.arange(len(sets))[::-1]
    colours = np.where(sets["final"], AUGMENTED, "#9FC5DE")
    behind = sets.groupby("part")["refitted_nats"].transform("max") - sets["refitted_nats"]
    axes.hlines(place, 0, behind, color=colours, lw=1.2, alpha=0.6)
    axes.scatter(behind, place, s=30, marker="D", color=colours, zorder=3)
    axes.set_yticks(place, [title(h).replace(" + ", " +\n") for h in sets["hypothesis"]])
    axes.set_ylim(-0.8, max(len(sets), 6) - 0.2)
    axes.set_xscale("symlog", linthresh=LINEAR)
    axes.axvspan(0, CLASS, color=AUGMENTED, alpha=0.12, lw=0)
    axes.set_xlim(-1, max(2 * LINEAR, 1.5 * behind.max()))
    _label(axes)
    axes.invert_xaxis()
    axes.set_xlabel("nats behind the best of these")
    axes.grid(axis="y", visible=False)


def _nats(axes: Axes, most: float) -> None:
    """The axis of evidence, with what counts as found and what as alike."""
    axes.set_xscale("symlog", linthresh=LINEAR)
    axes.axvline(0, color="black", lw=0.8)
    axes.axvline(LEAST_EVIDENCE, color="black", lw=1, ls=":", label=f"least that counts, {LEAST_EVIDENCE:g}")
    if most > LEAST_EVIDENCE + CLASS:
        label = f"not told from the best, {CLASS:g}"
        axes.axvspan(most - CLASS, most, color=AUGMENTED, alpha=0.12, lw=0, label=label)
    _label(axes)
    axes.set_xlabel("evidence over the nominal scene (nats)")


def _label(axes: Axes) -> None:
    """Ticks of an axis of nats that is linear up to LINEAR."""
    low, high = axes.get_xlim()
    crowded = high > CROWDED
    shown = [t for t in _TICKS if low <= t <= high and not (crowded and abs(t) == 1)]
    axes.set_xticks(shown, [f"{t:g}".replace("-", "−") for t in shown])
    axes.xaxis.set_minor_locator(NullLocator())
