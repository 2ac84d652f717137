"""Stage `joint_score`: unseal diagnosed cases of joints, score them, and write the results."""

import pandas as pd

from slapshot.blind_validation.case_table import JOINTS, write_measures
from slapshot.blind_validation.joints.page import measures_of, write_page
from slapshot.blind_validation.joints.score import COLUMNS, score
from slapshot.command import Run, stage_command
from slapshot.config.cases import JointScoreSettings
from slapshot.diagnosis.verdict import read_verdict
from slapshot.progress import progress


def produce(run: Run) -> None:
    """Write cases.csv, proof.csv and proof_joints.md."""
    conditions = run.settings(JointScoreSettings).cases
    rows = []
    for case in progress(sorted(conditions), len(conditions), "scoring"):
        verdict = read_verdict(run.inputs[f"verdict/{case}"])
        rows.append(score(case, conditions[case], run.inputs[f"case/{case}"], verdict))
    cases = pd.DataFrame(rows).reindex(columns=list(COLUMNS))
    cases.to_csv(run.out / "cases.csv", index=False, float_format="%.6g")
    measures = pd.DataFrame(measures_of(cases))
    write_measures(measures, JOINTS, run.out / "proof.csv")
    write_page(run.out / "proof_joints.md", cases, measures)


if __name__ == "__main__":
    stage_command("joint_score", produce)
