"""A rig that conceals something, or nothing, on which a session can be executed."""

from collections.abc import Sequence

import mujoco
from mujoco.batch import SimulationError

from slapshot.lab.joints.execution import TIP, Execution, MakeLaw, Motion
from slapshot.lab.joints.gripper import GripperExecution
from slapshot.lab.joints.hidden_effect import Concealed
from slapshot.lab.joints.rig import Excitation, Rig


class RigSimulator:
    """A rig with what it conceals.

    Args:
        rig: that moves.
        concealed: what it conceals.
        laws: that it follows besides.
    """

    def __init__(self, rig: Rig, concealed: Sequence[Concealed] = (), laws: Sequence[MakeLaw] = ()) -> None:
        self._rig = rig
        self._acting = [c for c in concealed if c.amplitude != 0]
        self._make = [*laws, *(_maker(c) for c in self._acting if c.kind.has("law"))]

    def execute(self, excitation: Excitation) -> Motion | None:
        """Simulate all episodes; None where one of them is beyond what can be simulated."""
        execution = GripperExecution if self._rig.drive == "mocap" else Execution
        try:
            return execution(self._rig, self.compile(), self._make, excitation).run()
        except (SimulationError, FloatingPointError):
            return None

    def compile(self) -> mujoco.MjModel:
        """The rig's true model."""
        spec = mujoco.MjSpec.from_string(self._rig.xml)
        assert not spec.compiler.degree, "angles of a rig's MJCF are in radians"
        body, place = self._rig.tip
        spec.body(body).add_site(name=TIP, pos=place)
        spec.option.timestep = self._rig.clock.step
        for c in self._acting:
            c.kind.build(c.amplitude, c.shape, spec, self._rig)
        model = spec.compile()
        for c in self._acting:
            c.kind.tune(c.amplitude, c.shape, model, self._rig)
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model


def _maker(concealed: Concealed) -> MakeLaw:
    return lambda plant: concealed.kind.law(concealed.amplitude, concealed.shape, plant)
