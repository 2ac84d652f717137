"""What the search of learning rates tells of itself."""

import pandas as pd
from slapshot.benchmark.tuning import by_rate


def test_a_best_rate_at_the_edge_of_the_grid_is_told():
    losses = {"middle": (3.0, 1.0, 2.0), "low": (1.0, 2.0, 3.0), "high": (3.0, 2.0, 1.0)}
    rows = [
        {"domain": "own", "method": method, "learning_rate": rate, "validation_loss": loss}
        for method, values in losses.items()
        for rate, loss in zip((0.001, 0.002, 0.004), values, strict=True)
    ]
    told = by_rate(pd.DataFrame(rows))["best at the edge"]
    assert told.to_dict() == {("own", "middle"): "no", ("own", "low"): "yes", ("own", "high"): "yes"}
