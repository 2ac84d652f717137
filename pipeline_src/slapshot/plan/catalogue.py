"""Stages, figures and claims with their modules."""

# Module that each stage runs: `python -m <module>`.
STAGES = {
    "scene": "slapshot.scenes.__main__",
    "demonstrations": "slapshot.trajectories.demonstrations",
    "trajectory_model": "slapshot.trajectories.fit",
    "swings": "slapshot.trajectories.pool",
    "rollouts": "slapshot.rollouts.__main__",
    "lab": "slapshot.lab.__main__",
    "train": "slapshot.adaptation.train",
    "evaluate": "slapshot.adaptation.evaluate",
    "evaluate_recording": "slapshot.adaptation.evaluate_recording",
    "calibrate": "slapshot.adaptation.calibrate",
    "predictions": "slapshot.adaptation.predictions",
    "beliefs": "slapshot.adaptation.beliefs",
    "inverse": "slapshot.acting.train_inverse",
    "acting": "slapshot.acting.__main__",
    "exploration": "slapshot.acting.exploration",
    "policy": "slapshot.policy.__main__",
    "policy_acting": "slapshot.policy.rigs",
    "refinement": "slapshot.refinement.__main__",
    "coverage": "slapshot.refinement.coverage",
    "refined_rollouts": "slapshot.refinement.rollouts",
    "refined_train": "slapshot.refinement.train",
    "refined_errors": "slapshot.refinement.errors",
    "regression": "slapshot.adaptation.regression",
    "claim": "slapshot.claims.__main__",
    "claims": "slapshot.claims.report",
    "figure": "slapshot.figures.__main__",
    "viewer": "slapshot.viewer.__main__",
    "diagnosis": "slapshot.diagnosis.pucks.stage_report",
    "signatures": "slapshot.diagnosis.pucks.stage_signatures",
    "case": "slapshot.lab.__main__",
    "verdict": "slapshot.diagnosis.pucks.stage_verdict",
    "score": "slapshot.proof.__main__",
    "findings": "slapshot.diagnosis.pucks.stage_findings",
    "arm_rollouts": "slapshot.retraining.rollouts",
    "held_out": "slapshot.retraining.held_out",
    "arms": "slapshot.retraining.__main__",
    "null_p_values": "slapshot.calibration.stage_null_p_values",
    "null_table": "slapshot.calibration.stage_null_table",
    "law_intervals": "slapshot.calibration.stage_law_intervals",
    "coverage_table": "slapshot.calibration.stage_coverage_table",
}
# Made on demand and not part of `figures`: the bytes of a Rerun recording never repeat, and what builds on
# a diagnosis of a recording takes as long as all the rest; a calibration takes hours.
_CALIBRATION = ("null_p_values", "null_table", "law_intervals", "coverage_table")
ON_DEMAND = ("viewer", "diagnosis", "findings", "arm_rollouts", "held_out", "arms", *_CALIBRATION)
# Figure id -> its module.
FIGURES = {
    "A1": "slapshot.figures.a1_acting",
    "A2": "slapshot.figures.a2_exploration",
    "A3": "slapshot.figures.a3_refinement",
    "A4": "slapshot.figures.a4_policy",
    "A5": "slapshot.figures.a5_refined",
    "F1": "slapshot.figures.f1_intro",
    "F2": "slapshot.figures.f2_method",
    "F3": "slapshot.figures.f3_linear_regression",
    "F4": "slapshot.figures.f4_fetchslide",
    "F5": "slapshot.figures.f5_fetchslide_latents",
    "F6": "slapshot.figures.f6_setup",
    "F7": "slapshot.figures.f7_simulated",
    "F8": "slapshot.figures.f8_recorded",
    "F9": "slapshot.figures.f9_latents",
    "M1": "slapshot.figures.m1_training",
    "T1": "slapshot.figures.randomisation_table",
    "T2": "slapshot.figures.randomisation_table",
    "U1": "slapshot.figures.u1_coverage",
    "U2": "slapshot.figures.u2_innovations",
}
# Claim id -> its module.
_JUDGED = ("c1", "c2", "c3", "c4", "c5", "c6", "c7", "s11", "s12", "s13")
CLAIMS = {name.upper(): f"slapshot.claims.{name}" for name in _JUDGED}
