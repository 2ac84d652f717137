"""Stage `score`: unseal diagnosed cases, score them, and write tables and figures."""

from slapshot.blind_validation.case_table import write_cases_table
from slapshot.blind_validation.page import publish_proof
from slapshot.blind_validation.score import gain_share, score
from slapshot.command import Run, stage_command
from slapshot.config.cases import ScoreSettings
from slapshot.diagnosis.pucks.launch.signatures import Signatures
from slapshot.diagnosis.pucks.rig_file import setting_of
from slapshot.diagnosis.pucks.verdict_file import read_verdict
from slapshot.progress import progress
from slapshot.scenes.scene import Scene


def produce(run: Run) -> None:
    """Write proof.csv, proof.md, cases.csv and figures."""
    settings = run.settings(ScoreSettings)
    scene = Scene.load(run.inputs["scene"])
    setting = setting_of(scene, settings.friction)
    signatures = Signatures.load(run.inputs["signatures"] / "signatures.safetensors")
    conditions = settings.cases
    rows = []
    for case in progress(sorted(conditions), len(conditions), "scoring"):
        folder = run.inputs[f"case/{case}"]
        verdict, _ = read_verdict(run.inputs[f"verdict/{case}"])
        row = score(case, conditions[case], folder, verdict)
        if row.get("named") is not None and row["conceals"]:
            row["gain_share"] = gain_share(row, folder, setting, signatures, settings.diagnosis_seed)
        rows.append(row)
    write_cases_table(rows, run.out / "cases.csv")
    publish_proof(run.out, run.out, settings)


if __name__ == "__main__":
    stage_command("score", produce)
