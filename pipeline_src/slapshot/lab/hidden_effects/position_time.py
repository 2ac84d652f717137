"""Hidden effects on the slide that vary with the position on the board or with time."""

import numpy as np

from slapshot.arrays import Array
from slapshot.lab.board import draw_height, draw_log_friction
from slapshot.lab.hidden_effects.hidden_effect import HiddenEffect, NominalMotion, Shape
from slapshot.lab.surface import Ground

_WAVELENGTHS = (0.4, 1.6)  # m
_WAVES = 16


class UnevenBoard(HiddenEffect):
    """Hills and hollows: random waves in all directions."""

    name = "uneven_board"
    phase = "slide"
    parameter_match = None
    unit, amplitude, typical_amplitude, max_amplitude = "m/m", "rms slope", 0.01, 0.08

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"waves": draw_height(1.0, _WAVELENGTHS, _WAVES, rng).tolist()}

    def ground(self, amplitude: float, shape: Shape, ground: Ground) -> Ground:
        return ground.plus(height=_scaled(shape["waves"], amplitude))


class PlaceFriction(HiddenEffect):
    """Position-dependent friction: random waves, a worn lane, or a patch with a soft edge."""

    name = "place_friction"
    phase = "slide"
    parameter_match = None
    unit, amplitude, typical_amplitude, max_amplitude = (
        "1",
        "rms of waves, or size, of log friction",
        0.2,
        1.0,
    )

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        what = str(rng.choice(["waves", "lane", "patch"]))
        if what == "waves":
            return {"what": what, "waves": draw_log_friction(1.0, _WAVELENGTHS, _WAVES, rng).tolist()}
        place, ahead = _on_the_way(nominal, rng, 0.3, 0.8)
        size = (2.0, rng.uniform(0.08, 0.2)) if what == "lane" else rng.uniform(0.12, 0.3, 2)
        turned = ahead + (rng.normal(0, 0.2) if what == "lane" else rng.uniform(0, np.pi))
        return {
            "what": what,
            "sign": float(rng.choice((-1.0, 1.0))),
            "place_m": place.tolist(),
            "towards_rad": float(turned),
            "half_size_m": [float(size[0]), float(size[1])],
            "edge_m": float(rng.uniform(0.03, 0.08)),
        }

    def ground(self, amplitude: float, shape: Shape, ground: Ground) -> Ground:
        if shape["what"] == "waves":
            return ground.plus(log_friction=_scaled(shape["waves"], amplitude))
        angle = shape["towards_rad"]
        row = [
            *shape["place_m"], np.cos(angle), np.sin(angle), *shape["half_size_m"], shape["edge_m"],
            shape["sign"] * amplitude,
        ]  # fmt: skip
        return ground.plus(lanes=np.array([row]))


class AttractingSpot(HiddenEffect):
    """A magnet under the board and iron in the object: it pulls towards a spot, and down near it.

    No effect of the catalogue is like it: it is local, and it pushes and rubs at once.
    """

    name = "attracting_spot"
    phase = "slide"
    catalogued = False
    parameter_match = None
    unit, amplitude, typical_amplitude, max_amplitude = (
        "m/s^2",
        "largest acceleration along the board",
        0.5,
        1.8,
    )

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        place, _ = _on_the_way(nominal, rng, 0.3, 0.7)
        return {
            "place_m": place.tolist(),
            "depth_m": float(rng.uniform(0.12, 0.25)),
            "pull_share": float(rng.uniform(0.5, 1.5)),
        }

    def ground(self, amplitude: float, shape: Shape, ground: Ground) -> Ground:
        row = [*shape["place_m"], shape["depth_m"], amplitude, shape["pull_share"]]
        return ground.plus(magnets=np.array([row]))


class Tether(HiddenEffect):
    """A cable that drags behind the object and pulls it back once it is taut; it stretches with loss.

    No effect of the catalogue is like it: nothing happens up to a length, and paying out costs more than
    reeling in gives back.
    """

    name = "tether"
    phase = "slide"
    catalogued = False
    parameter_match = None
    unit, amplitude, typical_amplitude, max_amplitude = "1/s^2", "stiffness over mass", 2.0, 60.0

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        start = np.array(nominal.scene.info.start)
        anchor = start + rng.normal(0, 0.15, 2)
        travel = np.median(np.linalg.norm(nominal.rests - anchor, axis=1))
        return {
            "anchor_m": anchor.tolist(),
            "length_m": float(rng.uniform(0.35, 0.7) * travel),
            "loss_s_m": float(rng.uniform(0.2, 0.8)),
        }

    def ground(self, amplitude: float, shape: Shape, ground: Ground) -> Ground:
        row = [*shape["anchor_m"], shape["length_m"], amplitude, shape["loss_s_m"]]
        return ground.plus(tethers=np.array([row]))


class PulsingFan(HiddenEffect):
    """Air from one side: a jet across a strip of the board, or gusts in time with the hits, or both.

    No effect of the catalogue is like it: a jet has a curl, which no height has, and gusts follow the time.
    """

    name = "pulsing_fan"
    phase = "slide"
    catalogued = False
    parameter_match = None
    unit, amplitude, typical_amplitude, max_amplitude = (
        "m/s^2",
        "mean acceleration in the middle of the jet",
        0.2,
        0.9,
    )

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        what = str(rng.choice(["jet", "gusts", "both"]))
        place, ahead = _on_the_way(nominal, rng, 0.4, 0.8)
        side = ahead + rng.choice((-1.0, 1.0)) * rng.uniform(1.1, 2.0)
        return {
            "what": what,
            "place_m": place.tolist(),
            "towards_rad": float(side),
            "width_m": 0.0 if what == "gusts" else float(rng.uniform(0.12, 0.25)),
            "gust_share": 0.0 if what == "jet" else float(rng.uniform(0.7, 1.0)),
            "frequency_hz": float(rng.uniform(0.8, 2.0)),
            "phase_rad": float(rng.uniform(0, 2 * np.pi)),
        }

    def ground(self, amplitude: float, shape: Shape, ground: Ground) -> Ground:
        ux, uy = np.cos(shape["towards_rad"]), np.sin(shape["towards_rad"])
        x, y = shape["place_m"]
        # Gusts reach twice their mean, which at the largest is still less than friction holds.
        row = [
            ux, uy, ux * y - uy * x, shape["width_m"], amplitude, shape["gust_share"],
            shape["frequency_hz"], shape["phase_rad"],
        ]  # fmt: skip
        return ground.plus(fans=np.array([row]))


def _on_the_way(
    nominal: NominalMotion, rng: np.random.Generator, low: float, high: float
) -> tuple[Array, float]:
    """A point between the start and the rest point of some hit, and the direction (rad) to it."""
    start = np.array(nominal.scene.info.start)
    way = nominal.rests[rng.integers(len(nominal.rests))] - start
    return start + rng.uniform(low, high) * way, float(np.arctan2(way[1], way[0]))


def _scaled(waves: list[list[float]], amplitude: float) -> Array:
    field = np.array(waves)
    field[:, 2] *= amplitude
    return field


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
    unit, amplitude, typical_amplitude, max_amplitude = (
        "1",
        "log of friction last over first, but for the walk",
        0.2,
        1.5,
    )

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
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
