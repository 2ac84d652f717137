"""Figures of the blind validation.

Confusion matrix, detection by effect size, prediction errors, and calibration of stated probabilities.
"""

from collections.abc import Iterator

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from slapshot.effects.catalogue import catalogue
from slapshot.plotting import OTHER_COLOURS, STAND_IN, Drawing, use_style
from slapshot.statistics import wilson_interval

NO_NAME, MISMATCH, UNKNOWN = "no name", "mismatch", "unknown"
NULLS = {"clean": "null", "cluttered": "null, cluttered"}
P_BINS = 10
SURENESS = (0.0, 0.5, 0.75, 0.9, 1.0)  # edges of stated probabilities
SIZES = (0.0, 0.1, 0.2, 0.35, 0.5, 0.75, 1.1, 2.5)  # edges of displacement over scatter


def draw_all(cases: pd.DataFrame) -> Iterator[Drawing]:
    """Confusion, size, fit and calibration.

    Args:
        cases: of cases.csv.
    """
    use_style()
    whole = cases[~cases["condition"].str.contains("only")]  # recordings with fewer tables are excluded
    one = whole[(whole["conceals"] != "") & ~whole["conceals"].str.contains("+", regex=False)]
    yield _confusion(pd.concat([one, whole[whole["conceals"] == ""]]))
    yield _by_size(one)
    yield _fit(cases[cases["conceals"] != ""])
    yield _calibration(cases)


def _confusion(cases: pd.DataFrame) -> Drawing:
    """Confusion matrix of hidden and first-named effect; beside it, counts of mismatches and unknown flags.

    The flag means that something remains besides the named effects, so it is counted separately.
    """
    effects = list(catalogue())
    others = sorted(set(cases["conceals"]) - {*effects, ""})
    rows = [e for e in effects if e in set(cases["conceals"])] + others + ["nothing"]
    concealed = cases["conceals"].replace("", "nothing")
    first = cases["named"].str.split("+").str[0].replace("", NO_NAME)
    names = pd.crosstab(concealed, first).reindex(index=rows, columns=[*effects, NO_NAME], fill_value=0)
    flags = pd.DataFrame({MISMATCH: cases["found"], UNKNOWN: cases["unknown"]}).fillna(False).astype(int)
    called = flags.groupby(concealed).sum().reindex(rows, fill_value=0)
    of = concealed.value_counts().reindex(rows, fill_value=0)

    figure, panels = plt.subplots(
        1, 2, figsize=(9.6, 1.2 + 0.24 * len(rows)), sharey=True, width_ratios=[names.shape[1], 2.4]
    )
    for axes, counts, label in zip(panels, (names, called), ("named first", "called"), strict=True):
        share = counts.div(of.clip(lower=1), axis=0).to_numpy()
        axes.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        for i, j in zip(*np.nonzero(counts.to_numpy()), strict=True):
            colour = "white" if share[i, j] > 0.6 else "black"
            axes.text(j, i, str(counts.iloc[i, j]), ha="center", va="center", fontsize=7, color=colour)
        columns = [c.replace("_", " ") for c in counts.columns]
        axes.set_xticks(range(len(columns)), columns, rotation=55, ha="right", rotation_mode="anchor")
        axes.set_xlabel(label)
        axes.grid(False)
    panels[0].set_yticks(range(len(rows)), [f"{r.replace('_', ' ')} ({of[r]})" for r in rows])
    panels[0].set_ylabel("concealed (cases)")
    panels[1].tick_params(left=False)
    figure.suptitle(f"{_number(cases)} by what was concealed and what was said; {STAND_IN}", fontsize=9.5)
    table = pd.concat([_long(names, "named first"), _long(called, "called")], ignore_index=True)
    return Drawing("P1-confusion", figure, table.assign(of=table["concealed"].map(of)))


def _number(cases: pd.DataFrame) -> str:
    """How many cases, of how many hits each."""
    if cases.empty:
        return "0 cases"
    low, high = cases["hits"].min(), cases["hits"].max()
    return f"{len(cases)} cases of {low}{f' to {high}' if high > low else ''} hits"


def _long(counts: pd.DataFrame, panel: str) -> pd.DataFrame:
    """Counts that are not zero: panel, concealed, answer, cases."""
    long = counts.rename_axis("concealed").reset_index()
    long = long.melt("concealed", var_name="answer", value_name="cases")
    return long[long["cases"] > 0].assign(panel=panel)[["panel", "concealed", "answer", "cases"]]


def _by_size(cases: pd.DataFrame) -> Drawing:
    """Shares found, named and in the class, against size."""
    known = cases[cases["top1"].notna()]
    figure, axes = plt.subplots(figsize=(5.6, 3.4))
    rows = []
    bins = pd.cut(known["displacement"].astype(float), SIZES)
    columns = {"found": "called mismatched", "in_class": "truth in the class", "top1": "named first"}
    # Shifted sideways, so that equal values stay visible.
    for (column, text), colour, beside in zip(
        columns.items(), OTHER_COLOURS, (0.93, 1.0, 1.07), strict=False
    ):
        for interval, group in known.groupby(bins, observed=True):
            yes, n = int(group[column].astype(bool).sum()), len(group)
            ci = wilson_interval(yes, n)
            middle = beside * float(np.sqrt(max(interval.left, 0.03) * interval.right))
            rows.append(
                {"share": column, "size": middle, "value": ci.value, "low": ci.low, "high": ci.high, "n": n}
            )
        part = pd.DataFrame([r for r in rows if r["share"] == column])
        if len(part):
            error = [part["value"] - part["low"], part["high"] - part["value"]]
            axes.errorbar(
                part["size"], part["value"], yerr=error, marker="o", ms=4, capsize=3, color=colour, label=text
            )
    axes.set_xscale("log")
    axes.set_xlabel("size: displacement over hit-to-hit scatter")
    axes.set_ylabel("share of cases")
    axes.set_ylim(-0.03, 1.03)
    axes.set_xticks([0.1, 0.2, 0.5, 1, 2], ["0.1", "0.2", "0.5", "1", "2"])
    axes.minorticks_off()
    if rows:
        axes.legend(loc="lower right")
    axes.set_title(
        f"{_number(known)}, one catalogued effect concealed;\n95 % intervals; {STAND_IN}", loc="left"
    )
    return Drawing("P2-by-size", figure, pd.DataFrame(rows))


def _fit(cases: pd.DataFrame) -> Drawing:
    """Error over the noise floor before and after, case by case."""
    figure, axes = plt.subplots(1, 2, figsize=(8, 3.4))
    tables = []
    measures = {
        "track_rmse_m": "slide, given the launch",
        "command_rest_rmse_m": "rest point, given the command",
    }
    for axis, (measure, title) in zip(axes, measures.items(), strict=True):
        for (scene, text), colour in zip(
            {
                "nominal": "nominal, as believed",
                "refitted": "nominal, refitted",
                "augmented": "augmented",
            }.items(),
            OTHER_COLOURS,
            strict=False,
        ):
            floor = cases[f"noise_floor_{measure}"].astype(float)
            ratio = np.sort((cases[f"{scene}_{measure}"].astype(float) / floor).dropna())
            if not len(ratio):
                continue
            axis.step(
                ratio, np.arange(1, len(ratio) + 1) / len(ratio), where="post", color=colour, label=text
            )
            tables.append(pd.DataFrame({"measure": measure, "scene": scene, "over_floor": ratio}))
        axis.axvline(1.0, color="#888888", lw=1, ls=":")
        axis.set_xscale("log")
        axis.set_xlim(left=0.6)  # below are noise floors of launches with extreme scatter
        axis.set_xticks([1, 2, 5, 10], ["1", "2", "5", "10"])
        axis.minorticks_off()
        axis.set_xlabel("held-out error over the noise floor")
        # A case whose recording lacks tracks or commands lacks one of the two.
        measured = int(
            (cases[f"augmented_{measure}"].notna() & cases[f"noise_floor_{measure}"].notna()).sum()
        )
        axis.set_title(f"{title}; {measured} cases", loc="left")
    axes[0].set_ylabel("share of cases at most so far off")
    lines, texts = axes[0].get_legend_handles_labels()
    figure.legend(lines, texts, loc="outside lower center", ncols=len(lines))
    figure.suptitle(STAND_IN, fontsize=8)
    return Drawing("P3-fit", figure, pd.concat(tables) if tables else pd.DataFrame())


def _calibration(cases: pd.DataFrame) -> Drawing:
    """Histogram of p-values of nulls, and how often a name is right against its stated probability."""
    figure, axes = plt.subplots(1, 2, figsize=(8, 3.4))
    tables = [_p_values(axes[0], cases[cases["conceals"] == ""]), _reliability(axes[1], cases)]
    figure.suptitle(STAND_IN, fontsize=8)
    return Drawing("P4-calibration", figure, pd.concat(tables))


def _p_values(axes: Axes, nulls: pd.DataFrame) -> pd.DataFrame:
    """Share of nulls in each tenth of p; of a p-value that is one, a tenth each."""
    edges = np.linspace(0, 1, P_BINS + 1)
    rows = []
    for (group, condition), colour in zip(NULLS.items(), OTHER_COLOURS, strict=False):
        p = nulls.loc[nulls["condition"] == condition, "p_value"].astype(float).dropna()
        if not len(p):
            continue
        share = np.histogram(p, edges)[0] / len(p)
        axes.stairs(share, edges, color=colour, lw=1.5, label=f"{group}, {len(p)} recordings")
        rows += [
            {"panel": "p-values", "group": group, "low": low, "high": high, "share": float(s), "n": len(p)}
            for low, high, s in zip(edges[:-1], edges[1:], share, strict=True)
        ]
    axes.axhline(1 / P_BINS, color="#888888", lw=1, ls=":")
    axes.set_xlabel("p-value of a mismatch")
    axes.set_ylabel("share of recordings without any")
    axes.set_xlim(0, 1)
    axes.set_ylim(bottom=0)
    if rows:
        axes.legend()
    axes.set_title("p-values where nothing is concealed", loc="left")
    return pd.DataFrame(rows)


def _reliability(axes: Axes, cases: pd.DataFrame) -> pd.DataFrame:
    """Names of whatever was concealed; of nulls and uncatalogued physics no name is right."""
    named = cases[cases["stated_probability"].notna()]
    right = named["top1"].astype("boolean").fillna(False).astype(bool)
    stated = named["stated_probability"].astype(float)
    rows = []
    for interval, group in stated.groupby(pd.cut(stated, SURENESS), observed=True):
        ci = wilson_interval(int(right[group.index].sum()), len(group))
        rows.append(
            {
                "panel": "reliability", "group": f"{interval.left:g} to {interval.right:g}",
                "stated": float(group.mean()), "share": ci.value, "low": ci.low, "high": ci.high,
                "n": len(group),
            }
        )  # fmt: skip
    table = pd.DataFrame(rows)
    if not rows:
        axes.text(0.5, 0.5, "no name has a stated probability", ha="center", color="#888888")
    else:
        axes.plot([0, 1], [0, 1], color="#888888", lw=1, ls=":")
        error = [table["share"] - table["low"], table["high"] - table["share"]]
        axes.errorbar(
            table["stated"], table["share"], yerr=error, fmt="o", ms=4, capsize=3, color=OTHER_COLOURS[0]
        )
        for stated, share, count in table[["stated", "share", "n"]].itertuples(index=False):
            aside = (5, -10 if share > 0.1 else 5)  # points; not over the axis
            axes.annotate(f"{count:.0f}", (stated, share), aside, textcoords="offset points", fontsize=7)
    axes.set_xlabel("stated probability of the first name")
    axes.set_ylabel("share that is right")
    axes.set_xlim(0, 1.03)
    axes.set_ylim(0, 1.03)
    axes.set_title("names; numbers of cases, 95 % intervals", loc="left")
    return table
