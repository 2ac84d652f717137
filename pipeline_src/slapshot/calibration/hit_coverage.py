"""Coverage of 90 % intervals of hits: an effect of slide or camera is simulated, and it alone fitted."""

from collections.abc import Iterator

import numpy as np

from slapshot.calibration.slide_recordings import CAMERA, RADIUS, slide_recording
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter
from slapshot.diagnosis.pucks.selection.judgement import parameters_of
from slapshot.diagnosis.pucks.selection.search import Search
from slapshot.diagnosis.pucks.slide.noise import estimate_noise
from slapshot.diagnosis.pucks.slide.slide_model import SlideModel
from slapshot.diagnosis.pucks.slide.tracks import hit_tracks
from slapshot.effects.catalogue import catalogue
from slapshot.json_types import Row

YAW_SD = 0.02  # rad


def intervals(name: str, seed: int, hits: int) -> Iterator[Row]:
    """Simulate a recording, fit it, and return truth and interval of each parameter.

    Args:
        name: of an effect of slide, camera or session that tracks tell, and no map of bumps.
        seed: of values, launches and noise, combined with the effect's name.
        hits: of the recording: tracks, with yaw where the effect follows spin.
    """
    rng = np.random.default_rng([seed, *name.encode()])
    effect = catalogue()[name]
    truth = {
        p.name: float(np.clip(p.neutral + p.scale * rng.normal(), p.low, p.high)) for p in effect.parameters
    }
    yaw_sd = YAW_SD if effect.follows == "spin" else None
    recording = slide_recording(rng, hits, {name: truth}, yaw_sd=yaw_sd)
    tracks = hit_tracks(recording)
    fitter = HitFitter(SlideModel(tracks, {name: effect}, RADIUS, CAMERA), estimate_noise(*tracks.resting))
    search = Search(fitter, [name], [], rng)
    common: Row = {"effect": name, "variant": "", "rig": f"tracks of {hits} hits", "seed": seed}
    try:
        nominal = search.nominal()
        fitted = search.settle(search.refit(nominal, [name], search.screen(nominal, [name]).direction))
        found = {p.name: p for p in parameters_of(search, fitted.fit, name)}
        converged = fitted.fit.converged
    except ArithmeticError:
        found, converged = {}, False
    for parameter, value in truth.items():
        told = found.get(parameter)
        low, high = (np.nan, np.nan) if told is None else (told.low, told.high)
        row: Row = {"parameter": parameter, "truth": value, "low": low, "high": high, "converged": converged}
        yield common | row
