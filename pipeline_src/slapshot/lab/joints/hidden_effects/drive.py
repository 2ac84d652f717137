"""Hidden effects between command and actuator torque."""

import numpy as np

from slapshot.arrays import Array
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
from slapshot.lab.joints.rig import Rig

_LATE = 0.1  # relative standard deviation of a command's delay
_HOT = 0.3  # heat at which a controller has folded back
_TABLE = 60  # entries of a table of ripple, for one period


class _OfActuators(HiddenEffect):
    def fits(self, rig: Rig) -> bool:
        return rig.drive != "mocap"


class ActuatorGain(_OfActuators):
    """Gain error of an actuator, which fades slightly at high torque."""

    name = "actuator_gain"
    unit, amplitude = "1", "size of what is added to a gain of 1"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        joint = draw_joint(nominal.rig, rng)
        return {
            "joint": joint,
            "sign": draw_sign(rng),
            "fades": float(rng.uniform(0.0, 0.2)),  # share of the error that is gone at the peak
            "peak_n_m": nominal.peak(nominal.rig.joints.index(joint)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.05, 0.0, 0.8 if shape["sign"] < 0 else 2.0)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"gain": (1 + shape["sign"] * amplitude, "1")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Gain(amplitude, shape, plant)


class _Gain(Law):
    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        self._error, self._shape = shape["sign"] * amplitude, shape
        self._joint = plant.rig.joints.index(shape["joint"])

    def drive(self, force: Array, state: StepState) -> None:
        own = force[:, self._joint]
        fading = 1 - self._shape["fades"] * np.minimum(np.abs(own) / self._shape["peak_n_m"], 1)
        own *= 1 + self._error * fading


class ActuatorLag(_OfActuators):
    """First-order lag of commands, which rise faster than they fall."""

    name = "actuator_lag"
    unit, amplitude = "s", "mean of the time constants of a rise and a fall"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"joint": draw_joint(nominal.rig, rng), "slower_fall": float(rng.uniform(0.0, 0.15))}

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
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

    def command(self, commands: Array, state: StepState) -> None:
        own = commands[:, self._joint]
        value = own.copy() if self._value is None else self._value
        change = own - value
        self._value = value + np.where(change > 0, self._up, self._down) * change
        own[:] = self._value


class CommandDelay(_OfActuators):
    """Command delay with jitter."""

    name = "command_delay"
    unit, amplitude = "s", "mean delay"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"joint": draw_joint(nominal.rig, rng), "stream": int(rng.integers(2**32))}

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(3e-3, 0.0, 0.1)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"delay": (amplitude, "s")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Delay(amplitude, shape, plant)


class _Delay(Law):
    """A queue of commands for every episode; a command that arrives within a step acts for part of it."""

    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        self._mean, self._timestep = amplitude, plant.timestep
        self._joint = plant.rig.joints.index(shape["joint"])
        self._rng = np.random.default_rng(shape["stream"])
        self._every = round(plant.rig.clock.period / plant.timestep)
        self._waiting: list[tuple[Array, Array]] = []  # when they arrive, and what they say
        self._step, self._value = 0, np.empty(0)

    def command(self, commands: Array, state: StepState) -> None:
        own = commands[:, self._joint]
        if self._step == 0:
            self._value = own.copy()
        if self._step % self._every == 0:
            delay = self._mean * (1 + _LATE * np.clip(self._rng.normal(size=len(own)), -3, 3))
            arrives = state.time - self._timestep / 2 + delay
            if self._waiting:  # no command overtakes another
                arrives = np.maximum(arrives, self._waiting[-1][0])
            self._waiting.append((arrives, own.copy()))
        self._step += 1
        end = state.time + self._timestep / 2
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
    """Torque limit of an actuator with a soft onset."""

    name = "saturation"
    unit, amplitude = "1", "share of the peak torque that is cut off"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        joint = draw_joint(nominal.rig, rng)
        peak = nominal.peak(nominal.rig.joints.index(joint))
        return {"joint": joint, "peak_n_m": peak, "sharpness": float(rng.uniform(8, 24))}

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.4, 0.0, 0.97)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"limit": ((1 - amplitude) * shape["peak_n_m"], "N m")}

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law:
        return _Limit(amplitude, shape, plant)


class _Limit(Law):
    def __init__(self, amplitude: float, shape: Shape, plant: Plant) -> None:
        self._limit, self._power = (1 - amplitude) * shape["peak_n_m"], shape["sharpness"]
        self._joint = plant.rig.joints.index(shape["joint"])

    def drive(self, force: Array, state: StepState) -> None:
        own = force[:, self._joint]
        own /= (1 + np.abs(own / self._limit) ** self._power) ** (1 / self._power)


class TorqueRipple(HiddenEffect):
    """Cogging: a torque over angle, from a periodic table with harmonics."""

    name = "torque_ripple"
    unit, amplitude = "N m", "rms of the table"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        harmonics = np.array((1.0, rng.uniform(0, 0.5), rng.uniform(0, 0.3)))
        phases = rng.uniform(0, 2 * np.pi, 3)
        angle = 2 * np.pi * np.arange(_TABLE) / _TABLE
        table = (harmonics[:, None] * np.sin(np.outer(np.arange(1, 4), angle) + phases[:, None])).sum(0)
        return {
            "joint": draw_joint(nominal.rig, rng),
            "per_turn": int(rng.integers(7, 25)),
            "table": (table / np.sqrt((table**2).mean())).tolist(),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        force = nominal.force(nominal.rig.joints.index(shape["joint"]))
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

    def act(self, torque: Array, state: StepState) -> None:
        periods = state.position[:, self._joint] * self._per_angle
        torque[:, self._dof] += np.interp(periods - np.floor(periods), self._entries, self._table)


class Foldback(_OfActuators):
    """Foldback protection: the torque rate is limited, and the limit drops after high load.

    It has no counterpart in the catalogue: the limit depends on the past.
    """

    name = "foldback"
    catalogued = False
    unit, amplitude = "1", "share of the peak torque above which heat gathers"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        joint = draw_joint(nominal.rig, rng)
        return {
            "joint": joint,
            "peak_n_m": nominal.peak(nominal.rig.joints.index(joint)),
            "heats_in_s": float(rng.uniform(0.03, 0.1)),
            "cools_in_s": float(rng.uniform(0.2, 0.6)),
            "fold": float(rng.uniform(0.1, 0.35)),
            "rise_s": float(rng.uniform(0.005, 0.03)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
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
        self._heat: Array = np.zeros(len(plant.session))
        self._last: Array | None = None

    def drive(self, force: Array, state: StepState) -> None:
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
