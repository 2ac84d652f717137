"""Pictures of the proof: who is taken for whom, from what size on, and what naming is worth."""

from collections.abc import Iterator

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.stats import binomtest

from slapshot.effects.catalogue import catalogue
from slapshot.figures.drawing import OTHER_COLOURS, STAND_IN, Drawing, use_style

SIZES = (0.0, 0.1, 0.2, 0.35, 0.5, 0.75, 1.1, 2.5)  # edges of displacement over scatter


def draw_all(cases: pd.DataFrame) -> Iterator[Drawing]:
    """Confusion, size and fit."""
    use_style()
    whole = cases[~cases["condition"].str.contains("only")]  # recordings that keep less are another matter
    one = whole[(whole["conceals"] != "") & ~whole["conceals"].str.contains("+", regex=False)]
    yield _confusion(pd.concat([one, whole[whole["conceals"] == ""]]))
    yield _by_size(one)
    yield _fit(cases[cases["conceals"] != ""])


def _confusion(cases: pd.DataFrame) -> Drawing:
    """Concealed against first named."""
    effects = list(catalogue())
    others = sorted(set(cases["conceals"]) - {*effects, ""})
    rows = [e for e in effects if e in set(cases["conceals"])] + others + ["nothing"]
    columns = [*effects, "unknown", "nothing"]
    table = pd.DataFrame(
        {
            "concealed": cases["conceals"].replace("", "nothing"),
            "named": [_said(r) for _, r in cases.iterrows()],
        }
    )
    counts = pd.crosstab(table["concealed"], table["named"]).reindex(
        index=rows, columns=columns, fill_value=0
    )
    share = counts.div(counts.sum(axis=1).clip(lower=1), axis=0).to_numpy()
    figure, axes = plt.subplots(figsize=(9, 0.6 + 0.24 * len(rows)))
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for i, j in zip(*np.nonzero(counts.to_numpy()), strict=True):
        colour = "white" if share[i, j] > 0.6 else "black"
        axes.text(j, i, str(counts.iloc[i, j]), ha="center", va="center", fontsize=7, color=colour)
    axes.set_xticks(range(len(columns)), [c.replace("_", " ") for c in columns], rotation=55, ha="right")
    axes.set_yticks(range(len(rows)), [r.replace("_", " ") for r in rows])
    axes.set_xlabel("named first")
    axes.set_ylabel("concealed")
    axes.set_title(f"{len(cases)} cases by what was concealed and what was said; {STAND_IN}", loc="left")
    axes.grid(False)
    long = counts.reset_index().melt("concealed", var_name="named", value_name="cases")
    return Drawing("P1-confusion", figure, long[long["cases"] > 0])


def _said(row: pd.Series) -> str:
    named = row.get("named")
    if isinstance(named, str) and named:
        first = named.split("+")[0]
        return "unknown" if row["unknown"] is True and row["phase"] is None else first
    return "unknown" if row.get("unknown") is True else "nothing"


def _by_size(cases: pd.DataFrame) -> Drawing:
    """Shares found, named and in the class, against size."""
    known = cases[cases["top1"].notna()] if "top1" in cases else cases[:0]
    figure, axes = plt.subplots(figsize=(5.6, 3.4))
    rows = []
    bins = pd.cut(known["displacement"].astype(float), SIZES)
    columns = {"found": "called mismatched", "in_class": "truth in the class", "top1": "named first"}
    # Beside each other, where they are equal.
    for (column, text), colour, beside in zip(
        columns.items(), OTHER_COLOURS, (0.93, 1.0, 1.07), strict=False
    ):
        for interval, group in known.groupby(bins, observed=True):
            yes, n = int(group[column].astype(bool).sum()), len(group)
            ci = binomtest(yes, n).proportion_ci(0.95, method="wilson")
            middle = beside * float(np.sqrt(max(interval.left, 0.03) * interval.right))
            rows.append(
                {"share": column, "size": middle, "value": yes / n, "low": ci.low, "high": ci.high, "n": n}
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
    axes.legend(loc="lower right")
    axes.set_title(
        f"{len(known)} cases, one catalogued effect concealed; 95 % intervals;\n{STAND_IN}", loc="left"
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
        axis.set_xlim(left=0.6)  # below it are floors of launches that scatter wildly
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
