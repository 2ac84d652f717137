"""C2: Kalman against LSTM in FetchSlide (paper, section IV-B and figure 4)."""

from collections.abc import Mapping
from pathlib import Path

from slapshot.claims.comparison import drawn_errors, grows_with_noise, mean_ratio
from slapshot.claims.statement import Statement
from slapshot.parquet import read_frame
from slapshot.statistics import bootstrap

TITLE = "FetchSlide: Kalman beats LSTM most with few samples and with much noise"

FEW = slice(1, 11)  # samples 1 to 10, of 100
MANY = slice(-25, None)  # the last 25


def evaluate(inputs: Mapping[str, Path]) -> list[Statement]:
    """From the errors of both methods (role: method) on the same test conditions."""
    if not {"kalman", "lstm"} <= set(inputs):
        return []
    tables = {m: read_frame(inputs[m] / "errors.parquet") for m in ("kalman", "lstm")}
    levels = sorted(tables["kalman"]["noise_variance"].unique())
    quiet, loud = (
        [drawn_errors(tables[m][tables[m]["noise_variance"] == level]) for m in ("lstm", "kalman")]
        for level in (levels[0], levels[-1])
    )
    whole = [drawn_errors(tables[m]) for m in ("lstm", "kalman")]
    return [
        Statement(
            text="Kalman beats LSTM with few samples",
            measure="LSTM's error over Kalman's, mean over samples 1 to 10 and all levels of noise",
            interval=bootstrap(lambda a, b: mean_ratio(a, b, FEW), *whole),
            above=1,
            paper="outperforms the baseline most notably in the low-sample regime",
        ),
        Statement(
            text=f"Kalman beats LSTM at noise variance {levels[-1]:g}, outside training",
            measure="LSTM's error over Kalman's, mean over all samples from the first on",
            interval=bootstrap(lambda a, b: mean_ratio(a, b, slice(1, None)), *loud),
            above=1,
            paper="and high noise conditions",
        ),
        Statement(
            text="Kalman's lead is larger with few samples than with many",
            measure="that ratio over samples 1 to 10, over the ratio of the last 25 samples",
            interval=bootstrap(lambda a, b: mean_ratio(a, b, FEW) / mean_ratio(a, b, MANY), *whole),
            above=1,
            paper="most notably in the low-sample regime",
        ),
        Statement(
            text="Kalman's lead is larger with much noise than without",
            measure=f"the ratio over all samples at variance {levels[-1]:g}, over that at {levels[0]:g}",
            interval=bootstrap(
                lambda a, b, c, d: mean_ratio(a, b, slice(1, None)) / mean_ratio(c, d, slice(1, None)),
                *loud,
                *quiet,
            ),
            above=1,
            paper="most notably in [...] high noise conditions",
        ),
        *grows_with_noise(tables, FEW),
    ]
