import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from slapshot.viewer.hits import choose_evenly, even_quotas


@given(st.lists(st.integers(0, 12), max_size=9), st.integers(0, 60))
def test_quotas_are_as_equal_as_the_groups_allow(sizes, count):
    quotas = even_quotas(np.array(sizes, dtype=np.int64), count)
    assert quotas.sum() == min(count, sum(sizes))
    assert (quotas <= sizes).all()
    free = quotas[quotas < np.array(sizes)]  # only a group that gave all it has may have given fewer
    if len(free):
        assert quotas.max() <= free.min() + 1


@given(st.lists(st.integers(0, 4), max_size=40), st.integers(0, 50))
def test_rows_are_chosen_once_and_group_by_group(groups, count):
    table = pd.DataFrame({"group": groups, "row": range(len(groups))})
    selected = choose_evenly(table, ["group"], count)
    assert len(selected) == min(count, len(groups))
    assert selected["row"].is_unique
    assert selected["row"].isin(table["row"]).all()


def test_rows_are_spread_over_a_group():
    table = pd.DataFrame({"group": 0, "row": np.arange(100)}, index=np.arange(100) + 7)
    assert choose_evenly(table, ["group"], 4)["row"].tolist() == pytest.approx([12, 37, 62, 87])
