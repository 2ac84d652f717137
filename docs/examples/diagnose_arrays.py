"""The diagnosis as a library: arrays in, a verdict out.

A pendulum (simulated here, in place of a real one) has dry friction at its joint. Its model has none.
"""

import mujoco
import numpy as np
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.model.rig import bind
from slapshot.recordings.channels import Channel
from slapshot.recordings.signals import SignalRecording

MODEL = """
<mujoco model="pendulum">
  <option timestep="0.0025" integrator="RK4"/>
  <worldbody>
    <body name="link">
      <joint name="hinge" axis="0 1 0" damping="0.02"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.02" mass="0.5"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator>
</mujoco>
"""
FRICTION = 0.05  # N m, what the model lacks
NOISE = 0.001  # rad, of the encoder
RATE = 200  # Hz
EPISODES, DURATION = 6, 3.0  # s


def record(seed: int) -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]:
    """Times (n,) s, and for every episode the motor's torques (n,) N m and the joint's positions (n,) rad."""
    rng = np.random.default_rng(seed)
    robot = mujoco.MjModel.from_xml_string(MODEL)
    t = np.arange(round(DURATION * RATE)) / RATE
    torques, positions = [], []
    for _ in range(EPISODES):
        rates, phases = rng.uniform(0.3, 1.5, 3), rng.uniform(0, 2 * np.pi, 3)
        torque = 0.5 * np.sin(2 * np.pi * rates * t[:, None] + phases).sum(1)
        data, position = mujoco.MjData(robot), np.empty(len(t))
        for i in range(len(t)):
            position[i] = data.qpos[0]
            data.ctrl[0] = torque[i]
            while data.time < (i + 1) / RATE - 1e-9:
                # Dry friction turns around with the velocity.
                data.qfrc_applied[0] = -FRICTION * np.tanh(data.qvel[0] / 1e-3)
                mujoco.mj_step(robot, data)
        torques.append(torque)
        positions.append(position + rng.normal(0, NOISE, len(t)))
    return t, torques, positions


def main() -> None:
    """Record, diagnose, and print what was found."""
    t, torques, positions = record(seed=1)
    clock = {"clock": "main"}
    motor = Channel(
        **clock, role="control", quantity="command", actuator="motor", unit="N m", hold="previous"
    )
    encoder = Channel(**clock, role="observation", quantity="position", joint="hinge", unit="rad")
    recording = SignalRecording.from_arrays(
        [t] * EPISODES,
        {"motor": (motor, torques), "encoder": (encoder, positions)},
        rig="pendulum",
        stand_in=True,
    )
    rig = bind(mujoco.MjSpec.from_string(MODEL), recording.channels)
    verdict = diagnose(recording, rig, seed=0).verdict
    print(verdict.headline)
    for effect in verdict.effects:
        for parameter in effect.parameters:
            interval = f"90 % interval {parameter.low:.4f} to {parameter.high:.4f}"
            print(f"{effect.name}: {parameter.value:.4f} {parameter.unit}, {interval}")


if __name__ == "__main__":
    main()
