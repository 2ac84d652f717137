"""Compliant blade: the striker yields at a hinge along its upper edge."""

import math
from collections.abc import Mapping

import mujoco
import numpy as np

from slapshot.effects.effect import Effect, Parameter
from slapshot.scenes.scene import SceneInfo
from slapshot.scenes.striker import Striker

DAMPING_RATIO = 0.2
# s, damping over stiffness at least, so that springs of any stiffness are stable at steps of 0.5 ms: it is
# more than DAMPING_RATIO for a floorball blade's compliances below 0.005 rad/(N m).
LEAST_RETARDATION = 3e-4
_GEOM_FIELDS = (
    "type", "mass", "density", "typeinertia", "contype", "conaffinity", "condim", "priority", "friction",
    "solmix", "solref", "solimp", "margin", "gap", "rgba", "material", "group",
)  # fmt: skip


class CompliantBlade(Effect):
    name = "compliant_blade"
    phase = "contact"
    follows = "speed"
    parameters = (Parameter("compliance", "rad/(N m)", 0.0, 0.5, 0.02, "turn of the blade over moment"),)
    physics = (
        "The striker hangs on a hinge along its upper edge with spring and damper (a fifth of critical).\n"
        "It bends back at the impact and returns most of what it took while the object still touches it."
    )
    source = "Cross 1999, Impact of a ball with a bat or racket (American Journal of Physics 67)"

    def edit(self, values: Mapping[str, float], spec: mujoco.MjSpec, info: SceneInfo) -> None:
        """Hang the striker's geom on a body of its own; the site stays, as it is where one believes."""
        compliance = values["compliance"]
        if compliance == 0:
            return
        striker = Striker.of(spec, info)
        name, old = striker.geom.name, striker.geom
        edge = striker.pos + striker.height * striker.up
        body = old.parent.add_body(name=f"{name}_bent", pos=edge, gravcomp=old.parent.gravcomp)
        body.add_geom(
            name=f"{name}_moved",
            pos=striker.pos - edge,
            quat=striker.quat,
            size=striker.size,
            **{field: getattr(old, field) for field in _GEOM_FIELDS},
        )
        hinge = body.add_joint(
            name=f"{name}_bend",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=np.cross(striker.up, striker.normal),
            limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            armature=0.0,
            frictionloss=0.0,
            stiffness=1 / compliance,
        )
        spec.delete(old)
        spec.geom(f"{name}_moved").name = name
        model = spec.compile()
        inertia = float(model.dof_M0[model.joint(hinge.name).dofadr[0]])
        critical = 2 * math.sqrt(inertia / compliance)
        hinge.damping = (max(DAMPING_RATIO * critical, LEAST_RETARDATION / compliance), 0, 0)
