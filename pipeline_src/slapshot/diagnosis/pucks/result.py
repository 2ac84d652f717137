"""What a diagnosis is given beside a recording, and what it returns."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter
from slapshot.diagnosis.pucks.launch.signatures import Signatures
from slapshot.diagnosis.pucks.selection.level import Level
from slapshot.diagnosis.pucks.selection.search import Candidate, Screen, Search
from slapshot.diagnosis.pucks.verdict import Verdict
from slapshot.recordings.format import Recording
from slapshot.scenes.scene import Scene


@dataclass(frozen=True)
class Setting:
    """What a diagnosis knows of the scene.

    Attributes:
        radius: m, of the object as a disc.
        camera: (2,) m, point of the plane that the camera looks at.
        friction: nominal mu_x, mu_y and torsional friction in m.
        scene: to simulate commands with; None to use the slides alone.
    """

    radius: float
    camera: Array
    friction: tuple[float, float, float]
    scene: Scene | None = None


@dataclass(frozen=True)
class Diagnosis:
    """A verdict and what it was read from, for figures.

    Attributes:
        verdict: what was found.
        search: with its fitter (of the hits that were used for it) and all that was refitted; None where
            nothing could be told.
        nominal, final: fits without and with the effects that were found.
        screen: of all hypotheses at the nominal fit.
        held_out: fitter of the held-out hits.
        rests: the same for rest points, of a recording that has nothing else; None otherwise.
        signatures: of the commands, given or made; None likewise.
        recording: where nothing could be told, to show its hits.
        left_out: numbers of its hits that were not used -> why.
    """

    verdict: Verdict
    search: Search[HitFitter] | None = None
    nominal: Candidate | None = None
    final: Candidate | None = None
    screen: Screen | None = None
    held_out: HitFitter | None = None
    rests: Level | None = None
    signatures: Signatures | None = None
    recording: Recording | None = None
    left_out: Mapping[int, str] = field(default_factory=dict)

    def values(self) -> dict[str, dict[str, float]]:
        """Effect -> parameter -> value of all effects that were found, and of errors fitted with them."""
        final = self.rests.final if self.rests is not None else self.final
        effects = {} if final is None else final.fit.point.effects
        return {name: dict(own) for name, own in effects.items()}
