"""C7: what the hidden state's principal components mean (paper, figure 9 and the text around it)."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.claims.statement import Statement
from slapshot.latent_space import at_samples, fit_projection, read_latents
from slapshot.statistics import Projection, bootstrap

TITLE = "hockey, PCA of the Kalman model's phi: friction's magnitude first, its direction second"

SAMPLES = 20  # of the paper's figure 9 (a)

Array = NDArray[np.floating]


def evaluate(inputs: Mapping[str, Path]) -> list[Statement]:
    """From the hidden states of the Kalman model (role: beliefs)."""
    latents = read_latents(inputs["beliefs"])
    projections = {int(str(m)): fit_projection(rows) for m, rows in latents.groupby("model")}
    seen = at_samples(latents, SAMPLES)
    drawn = seen[(seen["source"] == "simulated") & (seen["name"] == "") & seen["noise_variance"].notna()]
    table = _scores(drawn, projections)
    statements = [
        Statement(
            text=f"The {position} component follows the {what} of friction rather than its {other}",
            measure=f"|correlation| with the {what} less |correlation| with the {other}",
            interval=bootstrap(
                lambda a, i=component, j=guide: _correlation(a, i, j) - _correlation(a, i, 1 - j), table
            ),
            above=0,
            paper="friction increases along the first, the second encodes its direction",
            note=(
                f"|correlation| with the {what}: {_correlation(table, component, guide):.2f}; magnitude is "
                "log sqrt(mu_x mu_y), direction is log(mu_y / mu_x); drawn test conditions"
            ),
        )
        for component, (position, what, other, guide) in enumerate(
            (("first", "magnitude", "direction", 0), ("second", "direction", "magnitude", 1))
        )
    ]
    return [*statements, *_recorded(seen, projections)]


def _scores(rows: pd.DataFrame, projections: Mapping[int, Projection]) -> Array:
    """(models, conditions, 4): two components, friction's magnitude and direction, means over the rest."""
    parts = []
    for model, own in rows.groupby("model"):
        scores = projections[int(str(model))].apply(np.stack(own["hidden"].to_list()))
        own = own.assign(first=scores[:, 0], second=scores[:, 1])
        parts.append(
            own.groupby("condition")[["first", "second", "magnitude", "direction"]].mean().to_numpy()
        )
    return np.stack(parts)


def _correlation(table: Array, component: int, guide: int) -> float:
    """Mean over models of |correlation| over conditions between a component and a guide."""
    pairs = [np.corrcoef(rows[:, component], rows[:, 2 + guide])[0, 1] for rows in table]
    return float(np.abs(pairs).mean())


def _recorded(seen: pd.DataFrame, projections: Mapping[int, Projection]) -> list[Statement]:
    """Where the recorded pucks lie along the first component, between low (0) and medium friction (1)."""
    named = seen[seen["name"].isin(["low friction", "medium friction"])]
    recorded = seen[seen["source"] == "recorded"]
    if named.empty or recorded.empty:
        return []
    parts = []
    for model, projection in projections.items():

        def first(rows: pd.DataFrame, projection: Projection = projection) -> Array:
            return projection.apply(np.stack(rows["hidden"].to_list()))[:, 0]

        own = named[named["model"] == model]
        low, medium = (first(own[own["name"] == f"{k} friction"]).mean() for k in ("low", "medium"))
        rows = recorded[recorded["model"] == model]
        position = rows.assign(position=(first(rows) - low) / (medium - low))
        parts.append(position.groupby(["recording", "rig"])["position"].mean().to_numpy())
    positions = np.stack(parts)[..., None]
    return [
        Statement(
            text="The recorded pucks lie between low and medium friction",
            measure="place along the first component, mean over rigs; low friction is 0, medium 1",
            interval=bootstrap(lambda a: float(a.mean()), positions),
            above=0,
            below=1,
            paper="between medium and low friction",
            note=(
                "true by construction on a stand-in, whose friction is drawn between those two; here it says "
                "only that the hidden state finds it there"
            ),
        )
    ]
