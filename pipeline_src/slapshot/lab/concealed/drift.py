"""Concealed across hits: what changes in the course of a session."""

from typing import Any

import numpy as np

from slapshot.lab.concealed.hidden_effect import HiddenEffect, NominalMotion, Shape

_TERMS = 16  # of the random walk


class FrictionDrift(HiddenEffect):
    """Friction wears towards another value, with a random walk on top, over u in [0, 1].

        log factor = sign amplitude ((1 - e^(-u / tau)) / (1 - e^(-1 / tau)) + walk(u)) less its mean,
        walk(u) = share sqrt(2) sum_k c_k sin((k - 1/2) pi u) / ((k - 1/2) pi),  c_k standard normal

    which is Karhunen and Loeve's series of Brownian motion, so that a walk does not depend on how many hits
    there are.
    """

    name = "friction_drift"
    phase = "across hits"
    unit, amplitude, usual, largest = "1", "log of friction last over first, but for the walk", 0.2, 1.5

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        return {
            "sign": float(rng.choice((-1.0, 1.0))),
            "saturation": float(rng.uniform(0.25, 1.0)),
            "walk_share": float(rng.uniform(0.0, 0.15)),
            "walk": rng.normal(size=_TERMS).tolist(),
        }

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"log_change": shape["sign"] * amplitude}

    def log_friction(self, amplitude: float, shape: Shape, place: float) -> float:
        tau, share = shape["saturation"], shape["walk_share"]
        rate = (np.arange(_TERMS) + 0.5) * np.pi
        scale = 1 / (1 - np.exp(-1 / tau))
        worn = scale * (1 - np.exp(-place / tau))
        walk = share * np.sqrt(2) * np.array(shape["walk"]) / rate
        mean = scale * (1 - tau * (1 - np.exp(-1 / tau))) + walk @ (1 / rate)
        return float(shape["sign"] * amplitude * (worn + walk @ np.sin(rate * place) - mean))
