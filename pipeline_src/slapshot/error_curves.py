"""Error against number of samples: the curves of most figures."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from slapshot.plotting import method_colour, method_line, method_name


def summarise(errors: pd.DataFrame, by: list[str], unit: str = "model") -> pd.DataFrame:
    """Mean, standard deviation and interval of error_m, grouped by the columns `by` and samples.

    sd_m is the standard deviation over models and tasks, which the paper shades; mean_low_m and
    mean_high_m are a 95 % interval of the mean, from the scatter of the means of each `unit` (model, or
    rig) and Student's t.
    """
    keys = [*by, "samples"]
    grouped = errors.groupby(keys, observed=True)["error_m"]
    table = pd.DataFrame({"error_m": grouped.mean(), "sd_m": grouped.std(ddof=0), "n": grouped.size()})
    per_unit = errors.groupby([*keys, unit], observed=True)["error_m"].mean().groupby(keys, observed=True)
    count = per_unit.size()
    half = _student(count) * per_unit.std(ddof=1) / count**0.5
    table["mean_low_m"], table["mean_high_m"] = table["error_m"] - half, table["error_m"] + half
    return table.reset_index()


def _student(count: pd.Series) -> pd.Series:
    """97.5 % quantile of Student's t for `count` values; infinite for one."""
    from scipy.stats import t

    return count.map(lambda n: float(t.ppf(0.975, n - 1)) if n > 1 else float("inf"))


def draw_curves(
    axes: Axes, summary: pd.DataFrame, last: int | None = None, band: str = "", label: bool = True
) -> None:
    """Draw one line per method, in cm; nothing for an empty summary.

    Args:
        axes: to draw on.
        summary: from `summarise`, with a column `method`.
        last: largest number of samples to show.
        band: sd (one standard deviation), mean (95 % interval of the mean), or none.
        label: whether lines get an entry in a legend.
    """
    if summary.empty:
        return
    for method, rows in summary.groupby("method", sort=False):
        name = str(method)
        shown = rows if last is None else rows[rows["samples"] <= last]
        colour = method_colour(name)
        axes.plot(
            shown["samples"],
            100 * shown["error_m"],
            color=colour,
            linestyle=method_line(name),
            label=method_name(name) if label else None,
        )
        if band == "sd":
            low, high = shown["error_m"] - shown["sd_m"], shown["error_m"] + shown["sd_m"]
        else:
            low, high = shown["mean_low_m"], shown["mean_high_m"]
        if band:
            axes.fill_between(
                shown["samples"], 100 * low.clip(lower=0), 100 * high, color=colour, alpha=0.15, lw=0
            )
    axes.set_xlim(0, summary["samples"].max() if last is None else last)
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def panel_title(axes: Axes, letter: str, text: str) -> None:
    """A left-aligned title with its letter."""
    axes.set_title(f"({letter}) {text}", loc="left")
