"""C6: model adaptation against policy adaptation (paper, section "Physical experiments")."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.claims.comparison import samples_needed
from slapshot.claims.statement import Statement
from slapshot.parquet import read_frame
from slapshot.statistics import bootstrap

TITLE = "hockey, recorded: adapting a model takes fewer samples than adapting a policy"

# Own hits of the policy, the samples that the paper's model needs for the same error, and its words.
_PAPER = ((16, "7 against 16 (red puck), 3 against 16 (blue puck)"), (64, "7 against 64, for 13.8 cm"))
SEVEN = 7.0

Array = NDArray[np.floating]


def evaluate(inputs: Mapping[str, Path]) -> list[Statement]:
    """From hits of policies and models on every rig, and the model's predictions.

    Roles: policy_acting/rig, acting/rig, predicted.
    """
    own = _joined(inputs, "policy_acting", "policy.parquet").rename(columns={"hits": "samples"})
    acted = _joined(inputs, "acting", "acting.parquet")
    acted = acted[acted["chooser"] == "gradient"]
    kalman = acted[acted["method"] == acted["method"].iloc[0]]
    predicted = read_frame(inputs["predicted"] / "errors.parquet")
    ways = (
        ("predictions reach the error", "predicts recorded rest points", _curves(predicted)),
        ("hits reach the distance", "hits targets by gradient", _curves(kalman)),
    )
    policy = _curves(own)
    statements = []
    for text, how, model in ways:
        rigs = [rig for rig in policy.index if rig in model.index]
        for hits, paper in _PAPER:
            if hits not in policy.columns:
                continue
            reached = policy.loc[rigs, [hits]].to_numpy()[None]
            curve = model.loc[rigs].to_numpy()[None]
            samples = np.array(model.columns, float)
            fewer = min(float(hits), SEVEN)
            statements.append(
                Statement(
                    text=f"The model's {text} of the policy after {hits} own hits in {fewer:g} or fewer",
                    measure="samples that the model needs",
                    interval=bootstrap(lambda a, b, s=samples: samples_needed(a, b, s), curve, reached),
                    below=fewer + 0.5,
                    paper=paper,
                    note=(
                        f"policy {100 * policy.loc[rigs, 0].mean():.1f} cm before any hit, "
                        f"{100 * reached.mean():.1f} cm after {hits}; the model {how}, "
                        f"{100 * curve[0, :, -1].mean():.1f} cm after {samples[-1]:g}; "
                        f"{len(rigs)} stand-in rigs; both trained on as many simulated hits"
                    ),
                )
            )
    return statements


def _joined(inputs: Mapping[str, Path], stage: str, file: str) -> pd.DataFrame:
    parts = [read_frame(f / file) for role, f in inputs.items() if role.startswith(f"{stage}/")]
    return pd.concat(parts, ignore_index=True)


def _curves(table: pd.DataFrame) -> pd.DataFrame:
    """Rigs x samples: mean error in m."""
    return table.groupby(["rig", "samples"])["error_m"].mean().unstack("samples")
