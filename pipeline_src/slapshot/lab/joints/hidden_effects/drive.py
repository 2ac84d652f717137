"""Concealed between a command and what an actuator does."""

from typing import Any

import numpy as np

from slapshot.arrays import Array
from slapshot.lab.joints.hidden_effect import (
    Bounds,
    HiddenEffect,
    Law,
    NominalMotion,
    Now,
    Plant,
    Shape,
    draw_joint,
    draw_sign,
)
from slapshot.lab.joints.rig import Rig

_LATE = 0.1  # relative standard deviation of a command's delay
_HOT = 0.3  # heat at which a controller has folded back
_TABLE = 60  # entries of a table of ripple, for one period


class _OfActuators(HiddenEffect):
    def fits(self, rig: Rig) -> bool:
        return rig.drive != "mocap"


class ActuatorGain(_OfActuators):
    """An actuator does more or less than it was said to, a little less so the more it does."""

    name = "actuator_gain"
    unit, amplitude = "1", "size of what is added to a gain of 1"

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        joint = draw_joint(setting.rig, rng)
        return {
            "joint": joint,
            "sign": draw_sign(rng),
            "fades": float(rng.uniform(0.0, 0.2)),  # share of the error that is gone at the peak
            "peak_n_m": setting.peak(setting.rig.joints.index(joint)),
        }

    def bounds(self, setting: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.05, 0.0, 0.8 if shape["sign"] < 0 else 2.0)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"gain": (1 + shape["sign"] * amplitude, "1")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Gain(amplitude, shape, plant)


class _Gain(Law):
    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        self._error, self._shape = shape["sign"] * amplitude, shape
        self._joint = plant.rig.joints.index(shape["joint"])

    def drive(self, force: Array, now: Now) -> None:
        own = force[:, self._joint]
        fading = 1 - self._shape["fades"] * np.minimum(np.abs(own) / self._shape["peak_n_m"], 1)
        own *= 1 + self._error * fading


class ActuatorLag(_OfActuators):
    """A command comes through as through a low-pass filter of first order, which rises faster than it falls.

    A servo is told its angle late; a motor its torque.
    """

    name = "actuator_lag"
    unit, amplitude = "s", "mean of the time constants of a rise and a fall"

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        return {"joint": draw_joint(setting.rig, rng), "slower_fall": float(rng.uniform(0.0, 0.15))}

    def bounds(self, setting: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(3e-3, 0.0, 0.15)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"time_constant": (amplitude, "s")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Lag(amplitude, shape, plant)


class _Lag(Law):
    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        self._joint = plant.rig.joints.index(shape["joint"])
        times = amplitude * (1 + np.array((-1, 1)) * shape["slower_fall"] / 2)
        self._up, self._down = -np.expm1(-plant.timestep / times)
        self._value: Array | None = None

    def command(self, told: Array, now: Now) -> None:
        own = told[:, self._joint]
        value = own.copy() if self._value is None else self._value
        change = own - value
        self._value = value + np.where(change > 0, self._up, self._down) * change
        own[:] = self._value


class CommandDelay(_OfActuators):
    """Commands come late, one a little later than the other."""

    name = "command_delay"
    unit, amplitude = "s", "mean delay"

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        return {"joint": draw_joint(setting.rig, rng), "stream": int(rng.integers(2**32))}

    def bounds(self, setting: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(3e-3, 0.0, 0.1)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"delay": (amplitude, "s")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Delay(amplitude, shape, plant)


class _Delay(Law):
    """A queue of commands for every episode; one that arrives within a step acts for a part of it."""

    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        self._mean, self._timestep = amplitude, plant.timestep
        self._joint = plant.rig.joints.index(shape["joint"])
        self._rng = np.random.default_rng(shape["stream"])
        self._every = round(plant.rig.clock.period / plant.timestep)
        self._waiting: list[tuple[Array, Array]] = []  # when they arrive, and what they say
        self._step, self._value = 0, np.empty(0)

    def command(self, told: Array, now: Now) -> None:
        own = told[:, self._joint]
        if self._step == 0:
            self._value = own.copy()
        if self._step % self._every == 0:
            late = self._mean * (1 + _LATE * np.clip(self._rng.normal(size=len(own)), -3, 3))
            arrives = now.time - self._timestep / 2 + late
            if self._waiting:  # no command overtakes another
                arrives = np.maximum(arrives, self._waiting[-1][0])
            self._waiting.append((arrives, own.copy()))
        self._step += 1
        end = now.time + self._timestep / 2
        mean = self._value.copy()
        for arrives, value in self._waiting:
            share = np.clip((end - arrives) / self._timestep, 0, 1)
            if not share.any():
                break
            mean += share * (value - mean)
        while self._waiting and (self._waiting[0][0] <= end).all():
            self._value = self._waiting.pop(0)[1]
        own[:] = mean


class Saturation(_OfActuators):
    """An actuator does no more than so much, and gives in softly shortly before."""

    name = "saturation"
    unit, amplitude = "1", "share of the peak torque that is cut off"

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        joint = draw_joint(setting.rig, rng)
        peak = setting.peak(setting.rig.joints.index(joint))
        return {"joint": joint, "peak_n_m": peak, "sharpness": float(rng.uniform(8, 24))}

    def bounds(self, setting: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.4, 0.0, 0.97)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"limit": ((1 - amplitude) * shape["peak_n_m"], "N m")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Limit(amplitude, shape, plant)


class _Limit(Law):
    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        self._limit, self._power = (1 - amplitude) * shape["peak_n_m"], shape["sharpness"]
        self._joint = plant.rig.joints.index(shape["joint"])

    def drive(self, force: Array, now: Now) -> None:
        own = force[:, self._joint]
        own /= (1 + np.abs(own / self._limit) ** self._power) ** (1 / self._power)


class TorqueRipple(HiddenEffect):
    """Cogging: a torque by angle, from a table that repeats some times a turn and has harmonics."""

    name = "torque_ripple"
    unit, amplitude = "N m", "rms of the table"

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        harmonics = np.array((1.0, rng.uniform(0, 0.5), rng.uniform(0, 0.3)))
        phases = rng.uniform(0, 2 * np.pi, 3)
        angle = 2 * np.pi * np.arange(_TABLE) / _TABLE
        table = (harmonics[:, None] * np.sin(np.outer(np.arange(1, 4), angle) + phases[:, None])).sum(0)
        return {
            "joint": draw_joint(setting.rig, rng),
            "per_turn": int(rng.integers(7, 25)),
            "table": (table / np.sqrt((table**2).mean())).tolist(),
        }

    def bounds(self, setting: NominalMotion, shape: Shape) -> Bounds:
        force = setting.force(setting.rig.joints.index(shape["joint"]))
        return Bounds(0.05 * force, 0.0, 3 * force)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"rms": (amplitude, "N m"), "per_turn": (float(shape["per_turn"]), "1")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Ripple(amplitude, shape, plant)


class _Ripple(Law):
    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        self._table = amplitude * np.array([*shape["table"], shape["table"][0]])
        self._entries = np.arange(_TABLE + 1) / _TABLE
        self._per_angle = shape["per_turn"] / (2 * np.pi)
        self._joint, self._dof = plant.rig.joints.index(shape["joint"]), plant.dof(shape["joint"])

    def act(self, torque: Array, now: Now) -> None:
        place = now.position[:, self._joint] * self._per_angle
        torque[:, self._dof] += np.interp(place - np.floor(place), self._entries, self._table)


class Foldback(_OfActuators):
    """A controller that protects itself: torque rises only so fast, and falls back while it was much.

    No effect that rigs usually conceal is like it: the limit depends on what was before.
    """

    name = "foldback"
    catalogued = False
    unit, amplitude = "1", "share of the peak torque above which heat gathers"

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        joint = draw_joint(setting.rig, rng)
        return {
            "joint": joint,
            "peak_n_m": setting.peak(setting.rig.joints.index(joint)),
            "heats_in_s": float(rng.uniform(0.03, 0.1)),
            "cools_in_s": float(rng.uniform(0.2, 0.6)),
            "fold": float(rng.uniform(0.1, 0.35)),
            "rise_s": float(rng.uniform(0.005, 0.03)),
        }

    def bounds(self, setting: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.4, 0.0, 0.97)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"limit": ((1 - amplitude) * shape["peak_n_m"], "N m")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Fold(amplitude, shape, plant)


class _Fold(Law):
    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        self._joint = plant.rig.joints.index(shape["joint"])
        self._shape, self._timestep = shape, plant.timestep
        self._limit = (1 - amplitude) * shape["peak_n_m"]
        self._rise = shape["peak_n_m"] / (amplitude * shape["rise_s"]) * plant.timestep  # N m a step
        self._heat: Array = np.zeros(len(plant.place))
        self._last: Array | None = None

    def drive(self, force: Array, now: Now) -> None:
        own, shape = force[:, self._joint], self._shape
        over = np.abs(own) > self._limit
        time = np.where(over, shape["heats_in_s"], shape["cools_in_s"])
        self._heat += (over - self._heat) * self._timestep / time
        # Heat alone folds back: a cool controller lets the peak pass.
        folded, peak = self._limit * (1 - shape["fold"] * self._heat), shape["peak_n_m"]
        limit = peak - (peak - folded) * np.minimum(self._heat / _HOT, 1)
        wanted = np.clip(own, -limit, limit)
        last = wanted if self._last is None else self._last
        self._last = last + np.clip(wanted - last, -self._rise, self._rise)
        own[:] = self._last
