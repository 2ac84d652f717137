"""What a diagnosis fitted beside effects, for whoever simulates the rig anew: refit.json."""

import json
from pathlib import Path

import numpy as np

from slapshot.diagnosis.pucks.result import Diagnosis
from slapshot.diagnosis.pucks.selection.judgement import robust_covariance
from slapshot.json_types import JsonObject
from slapshot.recordings.format import Recording
from slapshot.whole_file import write_whole

REFIT_FILE = "refit.json"


def write_refit(diagnosis: Diagnosis, recording: Recording, folder: Path) -> None:
    """Write refit.json; nothing where slides could not be told.

    objects: object_id -> mass_kg, mass_sd_kg, and of the fits `nominal` and `final` (without and with what
    was found) friction [mu_x, mu_y, torsional in m] and log_sd of each. start_error_sd_m: of places where
    objects lay about where they were meant to, None where nobody saw them. held_out: numbers of hits that
    took no part in fitting or choosing.
    """
    search, nominal, final, held = diagnosis.search, diagnosis.nominal, diagnosis.final, diagnosis.held_out
    if search is None or nominal is None or final is None or held is None:
        return
    tracks = search.fitter.model.tracks
    objects: dict[str, JsonObject] = {}
    for k, name in enumerate(tracks.objects):
        info = recording.objects[name]
        objects[name] = {"mass_kg": info.mass_kg, "mass_sd_kg": info.mass_sd_kg}
        for scene, fit in (("nominal", nominal.fit), ("final", final.fit)):
            sd = np.sqrt(np.diag(robust_covariance(fit)))
            own = [c for c, column in enumerate(fit.columns) if column.object == k]
            objects[name][scene] = {
                "friction": np.exp(fit.point.nuisance[k]).tolist(),
                "log_sd": sd[own].tolist(),
            }
    aside = (tracks.seen_start - tracks.start)[~np.isnan(tracks.seen_start[:, 0])]
    text = json.dumps(
        {
            "objects": objects,
            "start_error_sd_m": float(np.sqrt((aside**2).mean())) if len(aside) else None,
            "held_out": sorted(int(hit) for hit in held.model.tracks.hit),
        },
        indent=2,
    )
    write_whole(folder / REFIT_FILE, text + "\n")
