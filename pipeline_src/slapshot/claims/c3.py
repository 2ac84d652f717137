"""C3: what the hidden states of Kalman and LSTM encode in FetchSlide (paper, figure 5 and its text)."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.claims.statement import Statement
from slapshot.latent_space import at_samples, fit_projection, read_latents
from slapshot.statistics import bootstrap

TITLE = "FetchSlide, PCA of hidden states: Kalman's follow friction, the LSTM's the number of samples"

FRICTIONS = ("low friction", "medium friction", "high friction")
EARLY, LATE = 19, 80  # samples: "less than 20", "even after observing 80"
# Share of correctly assigned states above which two conditions count as separated, a margin of our own.
SEPARATED = 0.9

Array = NDArray[np.floating]


def evaluate(inputs: Mapping[str, Path]) -> list[Statement]:
    """From the hidden states of both methods (role: method)."""
    scores = {method: _scores(folder) for method, folder in inputs.items()}
    statements = []
    if "kalman" in scores:
        early = at_samples(scores["kalman"], EARLY)
        seen = int(early["samples"].iloc[0])
        statements += [
            Statement(
                text="Kalman's first component orders low, medium and high friction",
                measure=f"smaller of the two steps between them over their spread, after {seen} samples",
                interval=bootstrap(_smaller_step, _by_friction(early)),
                above=0,
                paper="the dynamics lie in the order of decreasing friction",
                note="one condition each; the interval is over models and random orders of their hits",
            ),
            _separated(early, "kalman", seen, holds=True),
        ]
    if "lstm" in scores:
        late = at_samples(scores["lstm"], LATE)
        statements.append(_separated(late, "lstm", int(late["samples"].iloc[0]), holds=False))
    if {"kalman", "lstm"} <= set(scores):
        statements.append(
            Statement(
                text="The LSTM's states encode how many samples it has seen, Kalman's do not",
                measure="share of the plane's variance that samples seen explain, LSTM's less Kalman's",
                interval=bootstrap(
                    lambda a, b: _explained_by_samples(a) - _explained_by_samples(b),
                    *(_by_samples(scores[m]) for m in ("lstm", "kalman")),
                ),
                above=0,
                paper="the LSTM model encodes uncertainty, as expressed by the number of observed samples",
                note=", ".join(
                    f"{m}: {_explained_by_samples(_by_samples(t)):.2f}" for m, t in scores.items()
                ),
            )
        )
    return statements


def _scores(folder: Path) -> pd.DataFrame:
    """Hidden states with their two principal components, each model's over its largest standard deviation."""
    latents = read_latents(folder)
    latents = latents[latents["noise_variance"].notna() & (latents["source"] == "simulated")]
    parts = []
    for _, own in latents.groupby("model"):
        scores = fit_projection(own).apply(np.stack(own["hidden"].to_list()))
        scores = scores / scores.std(0).max()
        parts.append(own.drop(columns="hidden").assign(pc1=scores[:, 0], pc2=scores[:, 1]))
    return pd.concat(parts, ignore_index=True)


def _by_friction(rows: pd.DataFrame) -> Array:
    """(models, orders of hits and levels of noise, frictions, 2)."""
    named = rows[rows["name"].isin(FRICTIONS)].sort_values(["model", "repeat", "noise_variance"])
    models = named["model"].nunique()
    each = [
        named.loc[named["name"] == name, ["pc1", "pc2"]].to_numpy().reshape(models, -1, 2)
        for name in FRICTIONS
    ]
    return np.stack(each, axis=2)


def _smaller_step(table: Array) -> float:
    """Least of the steps low to medium and medium to high along the first component, mean over models."""
    first = table[..., 0]
    steps = np.diff(first.mean(1), axis=1)
    return float((steps / np.maximum(first.std(1).mean(1), 1e-9)[:, None]).min(1).mean())


def _separated(rows: pd.DataFrame, method: str, seen: int, holds: bool) -> Statement:
    name = {"kalman": "Kalman", "lstm": "The LSTM"}[method]
    return Statement(
        text=f"{name} {'parts' if holds else 'does not part'} medium from high friction after {seen} samples",
        measure="share of states nearer to their own condition's mean in the plane of two components",
        interval=bootstrap(_separated_share, _by_friction(rows)),
        above=SEPARATED if holds else -np.inf,
        below=np.inf if holds else SEPARATED,
        paper="already with less than 20 samples" if holds else "span the same area even after observing 80",
        note=f"0.5 is chance; parted from {SEPARATED:g} on, a margin of our own",
    )


def _separated_share(table: Array) -> float:
    """Of the states at medium and high friction, those nearer to their own mean; mean over models."""
    pair = table[:, :, 1:]
    means = pair.mean(1)  # (models, 2 conditions, 2 components)
    distance = np.linalg.norm(pair[:, :, :, None] - means[:, None, None], axis=-1)
    right = np.stack([distance[:, :, i, i] < distance[:, :, i, 1 - i] for i in range(2)], axis=2)
    return float(right.mean())


def _by_samples(rows: pd.DataFrame) -> Array:
    """(models, conditions, numbers of samples, 2): means over orders of hits and noise, drawn conditions."""
    drawn = rows[(rows["name"] == "") & (rows["samples"] > 0)]
    means = drawn.groupby(["model", "condition", "samples"])[["pc1", "pc2"]].mean()
    shape = [means.index.get_level_values(k).nunique() for k in ("model", "condition", "samples")]
    return means.to_numpy().reshape(*shape, 2)


def _explained_by_samples(table: Array) -> float:
    """Variance between numbers of samples over all variance, of both components, mean over models."""
    between = table.mean(1).var(1).sum(-1)
    return float((between / table.reshape(len(table), -1, 2).var(1).sum(-1)).mean())
