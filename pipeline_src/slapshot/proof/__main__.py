"""Stage `score`: open the seals of diagnosed cases, score them, and tell it in table and picture."""

import json

import pandas as pd

from slapshot.command import Run, stage_command
from slapshot.diagnosis.rig_file import setting_of
from slapshot.diagnosis.signatures import Signatures
from slapshot.figures.drawing import save
from slapshot.progress import progress
from slapshot.proof import figures
from slapshot.proof.measures import measures_of
from slapshot.proof.page import write_page
from slapshot.proof.score import score
from slapshot.proof.true_family import gain_share
from slapshot.scenes.scene import Scene


def produce(run: Run) -> None:
    """Write proof.csv, proof.md, cases.csv and figures."""
    scene = Scene.load(run.inputs["scene"])
    setting = setting_of(scene, run.config["friction"])
    signatures = Signatures.load(run.inputs["signatures"] / "signatures.safetensors")
    conditions = run.config["cases"]
    rows = []
    for case in progress(sorted(conditions), len(conditions), "scoring"):
        folder = run.inputs[f"case/{case}"]
        verdict = json.loads((run.inputs[f"verdict/{case}"] / "verdict.json").read_text())
        row = score(case, conditions[case], folder, verdict)
        if row.get("named") is not None and row["conceals"]:
            row["gain_share"] = gain_share(row, folder, setting, signatures, run.config["diagnosis_seed"])
        rows.append(row)
    cases = pd.DataFrame(rows)
    cases.to_csv(run.out / "cases.csv", index=False, float_format="%.6g")
    measures = pd.DataFrame(measures_of(cases))
    measures.to_csv(run.out / "proof.csv", index=False, float_format="%.4g")
    write_page(run.out / "proof.md", cases, measures, run.config)
    for drawing in figures.draw_all(cases):
        save(drawing, run.out)


if __name__ == "__main__":
    stage_command("score", produce)
