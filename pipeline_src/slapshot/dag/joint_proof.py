"""Recipes of the blind validation for joints: cases of the joint lab, their verdicts, and the score."""

from pkgutil import iter_modules

from slapshot.config.cases import Cases, JointScoreSettings, JointVerdictSettings
from slapshot.dag.diagnosis import SEED
from slapshot.dag.proof import list_file
from slapshot.dag.recipes import Plan
from slapshot.effects import joints
from slapshot.lab.joints.case_spec import JointCaseSettings
from slapshot.lab.joints.cases import read_cases


def add_joint_proof(plan: Plan, cases: Cases) -> None:
    """Add a recording and a verdict for each case of the list, and one score.

    Raises:
        ProblemAtError: there is no such list.
        InputError: the list is invalid.
    """
    # The catalogue discovers its modules in its folder: no import in a stage's code names them.
    effects = [f"{joints.__name__}.{module.name}" for module in iter_modules(joints.__path__)]
    inputs: dict[str, str] = {}
    conditions: dict[str, str] = {}
    verdict = JointVerdictSettings(seed=SEED)
    for case in read_cases(list_file(cases, "joints"), possible=False):
        recorded, found = f"joint_case/{case.case}", f"joint_verdict/{case.case}"
        plan.add(recorded, "joint_case", JointCaseSettings(spec=case.spec))
        plan.add(found, "joint_verdict", verdict, {"case": recorded}, modules=effects)
        inputs |= {f"case/{case.case}": recorded, f"verdict/{case.case}": found}
        conditions[case.case] = case.condition
    plan.add("joint_score", "joint_score", JointScoreSettings(cases=conditions), inputs, modules=effects)
