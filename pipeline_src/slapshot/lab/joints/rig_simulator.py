"""Simulator of a rig with hidden effects."""

from collections.abc import Sequence

import mujoco
from mujoco.batch import SimulationError

from slapshot.lab.joints.execution import TIP, Execution, LawFactory, SimulatedMotion
from slapshot.lab.joints.gripper import GripperExecution
from slapshot.lab.joints.hidden_effect import Concealed
from slapshot.lab.joints.rig import Excitation, Rig


class RigSimulator:
    """A rig with hidden effects.

    Args:
        rig: nominal rig.
        concealed: hidden effects.
        laws: factories of further laws.
    """

    def __init__(
        self, rig: Rig, concealed: Sequence[Concealed] = (), laws: Sequence[LawFactory] = ()
    ) -> None:
        self._rig = rig
        self._acting = [c for c in concealed if c.amplitude != 0]
        self._law_factories = [*laws, *(_law_factory(c) for c in self._acting if c.effect.has("law"))]

    def execute(self, excitation: Excitation) -> SimulatedMotion | None:
        """Simulate all episodes; None if one of them is unstable."""
        execution = GripperExecution if self._rig.drive == "mocap" else Execution
        try:
            return execution(self._rig, self.compile(), self._law_factories, excitation).run()
        except (SimulationError, FloatingPointError):
            return None

    def compile(self) -> mujoco.MjModel:
        """The rig's true model."""
        spec = mujoco.MjSpec.from_string(self._rig.xml)
        assert not spec.compiler.degree, "angles of a rig's MJCF are in radians"
        body, position = self._rig.tip
        spec.body(body).add_site(name=TIP, pos=position)
        spec.option.timestep = self._rig.clock.step
        for c in self._acting:
            c.effect.build(c.amplitude, c.shape, spec, self._rig)
        model = spec.compile()
        for c in self._acting:
            c.effect.tune(c.amplitude, c.shape, model, self._rig)
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model


def _law_factory(concealed: Concealed) -> LawFactory:
    return lambda plant: concealed.effect.law(concealed.amplitude, concealed.shape, plant)
