"""Hidden effects on the slide that depend on speed, heading or spin."""

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.lab.hidden_effects.hidden_effect import HiddenEffect, NominalMotion, Shape
from slapshot.lab.surface import EVEN, Ground, rise
from slapshot.scenes.scene import Scene


class Tilt(HiddenEffect):
    """The board is not level, and faintly bowed: slope s + b (n.r - c) n, s at the middle of the rests."""

    name = "tilt"
    phase = "slide"
    parameter_match = "same"
    unit, amplitude, typical_amplitude, max_amplitude = (
        "m/m",
        "slope in the middle of where objects come to rest",
        0.01,
        0.1,
    )

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {
            "towards_rad": float(rng.uniform(0, 2 * np.pi)),
            "bow_share_per_m": float(rng.uniform(-0.3, 0.3)),
            "bow_towards_rad": float(rng.uniform(0, np.pi)),
            "middle_m": nominal.rests.mean(0).tolist(),
        }

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        slope_x, slope_y = amplitude * _unit(shape["towards_rad"])
        return {"slope_x": float(slope_x), "slope_y": float(slope_y)}

    def ground(self, amplitude: float, shape: Shape, ground: Ground) -> Ground:
        bow = _unit(shape["bow_towards_rad"])
        slope = amplitude * _unit(shape["towards_rad"])
        middle = float(bow @ np.array(shape["middle_m"]))
        return ground.plus(slopes=np.array([[*slope, amplitude * shape["bow_share_per_m"], *bow, middle]]))


class _Drag(HiddenEffect):
    """a = -amplitude |v|^p, v in m/s."""

    phase = "slide"
    _powers = (1.0, 1.0)

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"power": float(rng.uniform(*self._powers))}

    def ground(self, amplitude: float, shape: Shape, ground: Ground) -> Ground:
        return ground.plus(drags=np.array([[amplitude, shape["power"]]]))


class LinearDrag(_Drag):
    """A film that thins a little under shear: drag with a power of speed between 1 and 1.2."""

    name = "linear_drag"
    unit, amplitude, typical_amplitude, max_amplitude = "1/s", "deceleration at 1 m/s over 1 m/s", 0.3, 5.0
    _powers = (1.0, 1.2)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"rate": amplitude}


class QuadraticDrag(_Drag):
    """Air whose drag coefficient changes with Reynolds' number: a power of speed between 1.8 and 2.2."""

    name = "quadratic_drag"
    unit, amplitude, typical_amplitude, max_amplitude = (
        "1/m",
        "deceleration at 1 m/s over (1 m/s)^2",
        0.2,
        3.0,
    )
    _powers = (1.8, 2.2)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"per_length": amplitude}


class StribeckFriction(HiddenEffect):
    """Friction falls as a point's slip grows: mu (1 + rise exp(-(v / v_s)^p)), or Lorentzian with p = 0.

    p = 2 would be the law that everybody writes down; Tustin's has p = 1, and Hess and Soom's is Lorentzian.
    """

    name = "stribeck_friction"
    phase = "slide"
    unit, amplitude, typical_amplitude, max_amplitude = (
        "1",
        "share by which friction at rest exceeds that at speed",
        0.3,
        3.0,
    )

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        lorentzian = bool(rng.uniform() < 0.4)
        power, speed = rng.uniform(0.7, 1.4), np.exp(rng.uniform(np.log(0.15), np.log(0.7)))
        return {"speed_m_s": float(speed), "power": 0.0 if lorentzian else float(power)}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        # Of the curve rise exp(-(v / v_s)^2) that comes nearest to this one up to 2 m/s.
        v, speeds = np.linspace(0, 2, 201), np.geomspace(0.05, 2, 200)
        curve = np.array([rise(self.ground(amplitude, shape, EVEN), slip) - 1 for slip in v])
        fades = np.exp(-((v / speeds[:, None]) ** 2))
        rises = fades @ curve / (fades**2).sum(1)
        best = int(((curve - rises[:, None] * fades) ** 2).sum(1).argmin())
        return {"rise": float(rises[best]), "log_speed": float(np.log(speeds[best]))}

    def ground(self, amplitude: float, shape: Shape, ground: Ground) -> Ground:
        return ground.plus(fades=np.array([[amplitude, shape["speed_m_s"], shape["power"]]]))


class TurnedAnisotropy(HiddenEffect):
    """Grooves askew to the axes, by Zmitrowicz's linear law, which is no law of maximum dissipation."""

    name = "turned_anisotropy"
    phase = "slide"
    unit, amplitude, typical_amplitude, max_amplitude = (
        "1",
        "share of friction added one way, taken across it",
        0.1,
        0.5,
    )

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        # Far enough from the axes, along which a ratio of the two frictions would be the same.
        angle = rng.choice((-1.0, 1.0)) * rng.uniform(np.pi / 6, np.pi / 3)
        return {"angle_rad": float(angle)}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        # With friction's logarithm S, a small cross term c gives c sin(2 h) along and 2 c cos(2 h) across
        # a heading h, this law a of both: c = 3 a / 5 comes nearest over all headings.
        return {"cross": 0.6 * amplitude * float(np.sin(2 * shape["angle_rad"]))}

    def ground(self, amplitude: float, shape: Shape, ground: Ground) -> Ground:
        return ground.plus(grooves=np.array([[amplitude, shape["angle_rad"]]]))


class Curl(HiddenEffect):
    """A spinning object bends its path: a = A w_s tanh(w / w_s) z x v, in proportion to spin at first."""

    name = "curl"
    phase = "slide"
    unit, amplitude, typical_amplitude, max_amplitude = (
        "1",
        "size of the force per spin, speed and mass",
        0.1,
        1.0,
    )

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"sign": float(rng.choice((-1.0, 1.0))), "saturation_rad_s": float(rng.uniform(0.4, 2.0))}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"strength": shape["sign"] * amplitude}

    def ground(self, amplitude: float, shape: Shape, ground: Ground) -> Ground:
        return ground.plus(curls=np.array([[shape["sign"] * amplitude, shape["saturation_rad_s"]]]))


class OffcentreMass(HiddenEffect):
    """A slug of metal in the object's rim: its centre of mass, its moment of inertia and its load move.

    A slug with the share s of the mass m at o / s from the middle of a disc of radius R puts the centre of
    mass at o, and the moment of inertia about it is m ((1 - s) R^2 / 2 + o^2 (1 - s) / s). The object is put
    down with a mark ahead, by eye.
    """

    name = "offcentre_mass"
    phase = "slide"
    parameter_match = "same"
    unit, amplitude, typical_amplitude, max_amplitude = (
        "m",
        "distance of the centre of mass from the middle",
        0.003,
        0.012,
    )
    changes_launch = True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {
            "towards_rad": float(rng.uniform(0, 2 * np.pi)),
            "slug_share": float(rng.uniform(0.4, 0.6)),
            "radius_m": nominal.scene.info.object_radius,
            "put_down_sd_rad": float(rng.uniform(0.03, 0.1)),
        }

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        x, y = amplitude * _unit(shape["towards_rad"])
        return {"offset_x": float(x), "offset_y": float(y)}

    def ground(self, amplitude: float, shape: Shape, ground: Ground) -> Ground:
        offset = amplitude * _unit(shape["towards_rad"])
        return ground.plus(centres=np.array([[*offset, self._inertia(amplitude, shape)]]))

    def edit(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, scene: Scene) -> None:
        compiled = spec.compile().body(scene.info.object_body)
        body = spec.body(scene.info.object_body)
        # Read before it is said that they are given, which forgets them.
        mass, inertia = float(compiled.mass[0]), compiled.inertia * self._inertia(amplitude, shape)
        place, quat = compiled.ipos.copy(), compiled.iquat.copy()
        place[:2] += amplitude * _unit(shape["towards_rad"])
        body.explicitinertial = True
        body.mass, body.inertia, body.ipos, body.iquat = mass, inertia, place, quat

    def yaw(self, amplitude: float, shape: Shape, chance: float) -> float:
        return shape["put_down_sd_rad"] * chance

    def _inertia(self, amplitude: float, shape: Shape) -> float:
        """Factor on a plain disc's."""
        share = shape["slug_share"]
        return (1 - share) * (1 + 2 * amplitude**2 / share / shape["radius_m"] ** 2)


def _unit(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])
