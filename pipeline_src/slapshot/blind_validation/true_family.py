"""What the effect that was really concealed would have gained, had it been named: fitted after the fact."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slapshot.diagnosis.pucks.diagnose import diagnose
from slapshot.diagnosis.pucks.result import Setting
from slapshot.diagnosis.pucks.signatures import Signatures
from slapshot.effects.catalogue import catalogue
from slapshot.recordings.read import read_recording

SLIDING = ("slide", "across hits", "camera")  # whose gain shows on held-out slides


def gain_share(
    row: Mapping[str, Any], case_folder: Path, setting: Setting, signatures: Signatures, seed: int
) -> float | None:
    """Held-out log-likelihood gained over that of the true family; None where slides show none.

    Args:
        row: of the scored case.
        case_folder: with recording/.
        setting: of the diagnosis.
        signatures: of the pool of commands.
        seed: of the diagnosis, so that the same hits are held out.
    """
    effects = catalogue()
    kinds = str(row["conceals"]).split("+")
    if not all(kind in effects and effects[kind].phase in SLIDING for kind in kinds) or not row["found"]:
        return None
    named = str(row["named"]).split("+")
    gained = row["augmented_loglik_per_hit"]
    if set(kinds) <= set(named):
        return 1.0
    known = {kind: effects[kind] for kind in kinds}
    recording = read_recording(case_folder / "recording")
    verdict = diagnose(recording, setting, seed, known, signatures=signatures).verdict
    possible = verdict.fit["augmented"].loglik_per_hit.value if verdict.fit else 0.0
    return float(gained / possible) if possible > 0 else None
