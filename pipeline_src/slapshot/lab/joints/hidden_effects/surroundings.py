"""Hidden effects of the surroundings: pushes, a cable, a magnet, an obstacle."""

import numpy as np

from slapshot.arrays import Array
from slapshot.lab.joints.execution import TIP
from slapshot.lab.joints.hidden_effect import (
    Bounds,
    HiddenEffect,
    Law,
    NominalMotion,
    Plant,
    Shape,
    StepState,
    draw_joint,
    draw_sign,
)

_LEVER = 0.4  # m, roughly, from the first joint to the tip
_TRIES = 500  # places that are tried
_WITHIN = (0.03, 0.25)  # share of the time in which a tip touches an obstacle


class ExternalPulse(HiddenEffect):
    """External pushes, one in each of some episodes."""

    name = "external_pulse"
    unit, amplitude = "N m", "torque at the height of a push"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        count = max(1, round(nominal.episodes / 3))
        episodes = np.sort(rng.permutation(nominal.episodes)[:count])
        lasts = rng.uniform(0.05, 0.3, count)
        begins = rng.uniform(0.1, nominal.seconds - 0.1 - lasts)
        pushes = zip(episodes, begins, begins + lasts, rng.choice((-1.0, 1.0), count), strict=True)
        return {
            "joint": draw_joint(nominal.rig, rng),
            "pushes": [
                {"episode": int(e), "from_s": float(a), "to_s": float(b), "sign": float(s)}
                for e, a, b, s in pushes
            ],
            "flat_share": float(rng.uniform(0.0, 0.7)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        force = nominal.force(nominal.rig.joints.index(shape["joint"]))
        return Bounds(0.3 * force, 0.0, 30 * force)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"torque": (amplitude, "N m")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Pushes(amplitude, shape, plant)


class _Pushes(Law):
    """Rise and fall are half a cosine each, with a flat part in between."""

    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        pushes = shape["pushes"]
        self._episodes = np.array([push["episode"] for push in pushes])
        self._begin, self._end = (np.array([push[key] for push in pushes]) for key in ("from_s", "to_s"))
        self._height = amplitude * np.array([push["sign"] for push in pushes])
        self._edge, self._dof = (1 - shape["flat_share"]) / 2, plant.dof(shape["joint"])

    def act(self, torque: Array, state: StepState) -> None:
        share = np.clip((state.time - self._begin) / (self._end - self._begin), 0, 1)
        rise = np.minimum(np.minimum(share, 1 - share) / self._edge, 1)
        torque[self._episodes, self._dof] += self._height * (1 - np.cos(np.pi * rise)) / 2


class SlackCable(HiddenEffect):
    """A cable from the tip to a hook beside the rig, which pulls when it is taut.

    It has no counterpart in the catalogue: it is unilateral and acts on all joints.
    """

    name = "slack_cable"
    catalogued = False
    unit, amplitude = "N/m", "stiffness of the taut cable"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        away = rng.normal(size=3)
        middle = nominal.tip.reshape(-1, 3).mean(0)
        hook = middle + away / np.linalg.norm(away) * rng.uniform(0.3, 0.6)
        distance = np.linalg.norm(nominal.tip - hook, axis=-1)
        return {
            "body": nominal.rig.tip[0],
            "hook_m": hook.tolist(),
            "slack_m": float(np.quantile(distance, rng.uniform(0.4, 0.8))),
            "damping_s": float(rng.uniform(0.001, 0.005)),  # over stiffness
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(10.0, 0.0, 5000.0)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"stiffness": (amplitude, "N/m"), "length": (shape["slack_m"], "m")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Cable(amplitude, shape, plant)


class _AtTip(Law):
    """Base class of position-dependent forces (episodes, 3) in N on the tip."""

    def __init__(self, plant: Plant) -> None:
        self._body, self._site = plant.model.site(TIP).bodyid[0], plant.model.site(TIP).id
        self._site_positions, self._centres = plant.batch.bind("site_xpos"), plant.batch.bind("xipos")
        self._timestep = plant.timestep
        self._last: Array | None = None

    def force(self, position: Array, velocity: Array) -> Array:
        raise NotImplementedError

    def push(self, wrench: Array, state: StepState) -> None:
        position = self._site_positions[:, self._site].copy()
        last = position if self._last is None else self._last
        velocity = (position - last) / self._timestep
        self._last = position
        position = position + velocity * self._timestep / 2
        force = self.force(position, velocity)
        wrench[:, self._body, :3] += force
        wrench[:, self._body, 3:] += np.cross(position - self._centres[:, self._body], force)


class _Cable(_AtTip):
    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        super().__init__(plant)
        self._stiffness, self._shape, self._hook = amplitude, shape, np.array(shape["hook_m"])

    def force(self, position: Array, velocity: Array) -> Array:
        way = self._hook - position
        length = np.linalg.norm(way, axis=1)
        stretch = length - self._shape["slack_m"]
        lengthens = -(velocity * way).sum(1) / length
        pull = self._stiffness * (stretch + self._shape["damping_s"] * lengthens)
        return np.where(stretch > 0, np.maximum(pull, 0) / length, 0)[:, None] * way


class Magnet(HiddenEffect):
    """A magnet beside the tip's path, which attracts or repels it when it comes near.

    It has no counterpart in the catalogue.
    """

    name = "magnet"
    catalogued = False
    unit, amplitude = "N", "largest force"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        path = nominal.tip.reshape(-1, 3)
        away = rng.normal(size=3)
        near = path[rng.integers(len(path))] + away / np.linalg.norm(away) * rng.uniform(0.01, 0.05)
        return {
            "body": nominal.rig.tip[0],
            "place_m": near.tolist(),
            "reach_m": float(rng.uniform(0.06, 0.12)),
            "sign": draw_sign(rng),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.5 * nominal.force(0) / _LEVER, 0.0, 1000.0)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"force": (shape["sign"] * amplitude, "N"), "reach": (shape["reach_m"], "m")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Magnet(amplitude, shape, plant)


class _Magnet(_AtTip):
    """Force f(u) = u / (1 + u^2)^(5/2) over its largest, u = distance over reach: a dipole's, blunted."""

    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        super().__init__(plant)
        self._place, self._reach = np.array(shape["place_m"]), shape["reach_m"]
        self._size = shape["sign"] * amplitude / (0.5 / 1.25**2.5)  # f is largest at u = 1/2

    def force(self, position: Array, velocity: Array) -> Array:
        way = (self._place - position) / self._reach
        return self._size * way / (1 + (way**2).sum(1, keepdims=True)) ** 2.5


class SoftObstacle(HiddenEffect):
    """A soft obstacle in the workspace, which the tip touches intermittently.

    It has no counterpart in the catalogue.
    """

    name = "intermittent_contact"
    catalogued = False
    unit, amplitude = "N/m^1.5", "Hertz's stiffness"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        path = nominal.tip.reshape(-1, 3)
        radius = float(rng.uniform(0.06, 0.12))
        best, miss = path[0], np.inf
        for _ in range(_TRIES):
            away = rng.normal(size=3)
            position = path[rng.integers(len(path))] + 0.7 * radius * away / np.linalg.norm(away)
            within = float((np.linalg.norm(path - position, axis=1) < radius).mean())
            off = max(_WITHIN[0] - within, within - _WITHIN[1], 0.0)
            if off < miss:
                best, miss = position, off
            if off == 0:
                break
        return {
            "body": nominal.rig.tip[0],
            "place_m": best.tolist(),
            "radius_m": radius,
            "damping_s_m": float(rng.uniform(0.1, 0.6)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(300.0, 0.0, 1e6)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"stiffness": (amplitude, self.unit), "radius": (shape["radius_m"], "m")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Obstacle(amplitude, shape, plant)


class _Obstacle(_AtTip):
    """Hunt and Crossley (1975): k d^1.5 (1 + c dd/dt) at a depth d."""

    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        super().__init__(plant)
        self._stiffness, self._shape, self._place = amplitude, shape, np.array(shape["place_m"])

    def force(self, position: Array, velocity: Array) -> Array:
        out = position - self._place
        distance = np.maximum(np.linalg.norm(out, axis=1), 1e-9)
        depth = np.maximum(self._shape["radius_m"] - distance, 0)
        deepens = -(velocity * out).sum(1) / distance
        size = self._stiffness * depth**1.5 * np.maximum(1 + self._shape["damping_s_m"] * deepens, 0)
        return (size / distance)[:, None] * out
