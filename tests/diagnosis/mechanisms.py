"""Small mechanisms and recordings of them, simulated by MuJoCo's plain step, at finer steps than any fit."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import mujoco
import numpy as np
from slapshot.arrays import Array
from slapshot.recordings.channels import Channel
from slapshot.recordings.signals import SignalRecording

# A rod with a motor; no gravity where told so. Damping 0.05 N m s, inertia about the axis 1/12 + 1/4 kg m².
PENDULUM = """
<mujoco>
  <option timestep="0.01" integrator="implicitfast"/>
  <worldbody>
    <body name="rod">
      <joint name="swing" axis="0 1 0" damping="0.05"/>
      <inertial mass="1" pos="0 0 -0.5" diaginertia="0.0833333333 0.0833333333 0.001"/>
      <site name="tip" pos="0 0 -1"/>
    </body>
  </worldbody>
  <actuator><motor name="drive" joint="swing"/></actuator>
</mujoco>
"""

# A mass on a rail without friction: the double integrator, 2 kg.
CART = """
<mujoco>
  <option timestep="0.01" gravity="0 0 0"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0"/>
      <inertial mass="2" pos="0 0 0" diaginertia="1 1 1"/>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="rail"/></actuator>
</mujoco>
"""

# Two links, the first with a servo, the second without a motor.
ARM = """
<mujoco>
  <option timestep="0.004" integrator="implicitfast"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="0.3"/>
      <inertial mass="1.2" pos="0 0 -0.2" diaginertia="0.02 0.02 0.002"/>
      <body name="lower" pos="0 0 -0.4">
        <joint name="elbow" axis="0 1 0" damping="0.1"/>
        <inertial mass="0.7" pos="0.02 0 -0.2" diaginertia="0.01 0.01 0.001"/>
        <site name="hand" pos="0 0.05 -0.4"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="shoulder" kp="30" kv="2"/></actuator>
</mujoco>
"""

# A brick that flies.
BRICK = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <body name="brick">
      <freejoint name="flight"/>
      <inertial mass="0.4" pos="0 0 0" diaginertia="0.001 0.002 0.003"/>
    </body>
  </worldbody>
</mujoco>
"""

# A body on a ball joint that hangs, with damping.
HANGER = """
<mujoco>
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>
    <body name="hanger">
      <joint name="hook" type="ball" damping="0.01"/>
      <inertial mass="0.5" pos="0.05 0 -0.3" diaginertia="0.004 0.005 0.002"/>
    </body>
  </worldbody>
</mujoco>
"""

_FINE = 10  # steps in an interval, from which data are those of a robot, which takes none
Law = Callable[[float, Array, Array], Array]  # time, qpos, qvel -> generalised force


def joint(name: str, quantity: str = "position", unit: str = "rad", **more: str) -> Channel:
    """An observed quantity of a joint."""
    return Channel(clock="encoder", role="observation", quantity=quantity, joint=name, unit=unit, **more)


def place(kind: str, name: str, component: str, quantity: str = "position") -> Channel:
    """An observed component of a site or body."""
    unit = {"position": "1" if component.startswith("q") else "m", "velocity": "m/s"}[quantity]
    target = {kind: name}
    return Channel(
        clock="encoder", role="observation", quantity=quantity, component=component, unit=unit, **target
    )


def control_channel(unit: str = "N m", hold: str = "previous", **of: str) -> Channel:
    """A control: of an actuator a command, of a joint a torque."""
    quantity = "command" if "actuator" in of else "torque"
    return Channel(clock="encoder", role="control", quantity=quantity, unit=unit, hold=hold, **of)


def simulate(
    model: mujoco.MjModel,
    t: Array,
    u: Array,
    qpos: Sequence[float],
    qvel: Sequence[float],
    *,
    finer: int = 10,
    law: Law | None = None,
) -> mujoco.MjData:
    """States at times t, with controls that hold from each to the next.

    Args:
        model: any; its time step does not matter, nor does its integrator from ten finer steps on.
        t: (n,) s, evenly spaced.
        u: (n, nu).
        qpos, qvel: first state.
        finer: steps of simulation in an interval.
        law: a force that the model does not have, evaluated at every fine step.

    Returns:
        (n, nq), (n, nv), (n, na) and the data of all sensors, (n, nsensordata).
    """
    model = mujoco.MjModel.from_xml_string(model) if isinstance(model, str) else model
    interval = float(t[1] - t[0])
    model.opt.timestep = interval / finer
    if finer >= _FINE:
        model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    found: list[tuple[Array, ...]] = []
    for moment, now in zip(t, u, strict=True):
        data.ctrl[:] = now
        mujoco.mj_forward(model, data)
        found.append(tuple(part.copy() for part in (data.qpos, data.qvel, data.act, data.sensordata)))
        for step in range(finer):
            if law is not None:
                data.qfrc_applied[:] = law(moment + step * interval / finer, data.qpos, data.qvel)
            mujoco.mj_step(model, data)
    return tuple(np.array(part) for part in zip(*found, strict=True))


def recording(
    t: Array | Sequence[Array], channels: Mapping[str, tuple[Channel, Array | Sequence[Array]]]
) -> SignalRecording:
    """A recording with one clock."""
    return SignalRecording.from_arrays(t, channels, "mechanism", stand_in=True)


def with_stamps(made: SignalRecording, names: Sequence[str], error: Array) -> SignalRecording:
    """The recording with some channels on a clock of their own, whose stamps err.

    Args:
        made: with one clock.
        names: of channels.
        error: (rows,) s, added to the times.
    """
    ((clock, table),) = made.signals.items()
    own = table[["episode", "t", *names]].assign(t=table["t"] + error).sort_values(["episode", "t"])
    own = own[own["t"] >= 0].reset_index(drop=True)
    channels = {
        name: channel.model_copy(update={"clock": "stamped"}) if name in names else channel
        for name, channel in made.channels.items()
    }
    return replace(made, channels=channels, signals={clock: table.drop(columns=names), "stamped": own})
