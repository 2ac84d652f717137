"""Which hits are shown: as many of every group as of any other, and spread over each group."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray


def choose_evenly(table: pd.DataFrame, groups: list[str], count: int) -> pd.DataFrame:
    """At most `count` rows of `table`, evenly over its groups and evenly spaced within each.

    Args:
        table: rows in an order that means something, for example that of execution.
        groups: columns that tell the groups apart.
        count: number of rows wanted.
    """
    members = [index.to_numpy() for _, index in table.index.to_series().groupby([table[g] for g in groups])]
    quotas = even_quotas(np.array([len(m) for m in members], dtype=np.int64), count)
    chosen = [m[_spread(len(m), int(quota))] for m, quota in zip(members, quotas, strict=True) if quota]
    return table.loc[np.concatenate(chosen)] if chosen else table.iloc[:0]


def even_quotas(sizes: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """(groups,) how many to take of each group of `sizes`, as equal as possible, `count` in all."""
    quotas = np.zeros_like(sizes)
    left = min(count, int(sizes.sum()))
    while left:
        with_more = np.flatnonzero(quotas < sizes)
        each = left // len(with_more)
        if each:
            step = np.minimum(each, sizes[with_more] - quotas[with_more])
        else:  # fewer than groups: a group here and there, not the first ones
            with_more = with_more[_spread(len(with_more), left)]
            step = np.ones_like(with_more)
        quotas[with_more] += step
        left -= int(step.sum())
    return quotas


def _spread(size: int, count: int) -> NDArray[np.int64]:
    """(count,) indices below `size`, evenly spaced, none twice."""
    return np.floor((np.arange(count) + 0.5) * size / count).astype(np.int64)
