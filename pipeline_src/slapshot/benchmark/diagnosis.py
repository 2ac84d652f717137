"""Duration of a diagnosis: of a null and of a plain case of the small blind validation, warm and cold."""

import time
from pathlib import Path

from slapshot.benchmark.measures import Measure
from slapshot.blind_validation.cases import read_cases
from slapshot.config.cases import VerdictSettings
from slapshot.config.configuration import Configuration
from slapshot.dag import make_plan
from slapshot.diagnosis.pucks.diagnose import diagnose
from slapshot.diagnosis.pucks.launch.signatures import Signatures
from slapshot.diagnosis.pucks.rig_file import setting_of
from slapshot.recordings.read import read_recording
from slapshot.scenes.scene import Scene
from slapshot.store.folder import Store

CONDITIONS = ("null", "plain")


def diagnosis_measures(config: Configuration, store: Store, cores: int) -> list[Measure]:
    """Time the first case of each condition; cold includes computing the sensitivities of its commands."""
    plan = make_plan(config)
    cases = read_cases(Path(config.cases.small))
    rows: list[Measure] = []
    for condition in CONDITIONS:
        case = next(case for case in cases if case.condition == condition)
        recipe = plan.recipes[f"verdict/small/{case.case}"]
        inputs = store.inputs(recipe)
        setting = setting_of(Scene.load(inputs["scene"]), recipe.settings(VerdictSettings).friction)
        recording = read_recording(inputs["recording"] / "recording")
        signatures = Signatures.load(inputs["signatures"] / "signatures.safetensors")
        diagnose(recording, setting, threads=cores, signatures=signatures)  # numba compiles
        for temperature, given in (("warm", signatures), ("cold", None)):
            began = time.perf_counter()
            diagnose(recording, setting, threads=cores, signatures=given)
            seconds = time.perf_counter() - began
            rows.append(Measure(f"diagnosis_seconds_{condition}_{temperature}", seconds, "s"))
    return rows
