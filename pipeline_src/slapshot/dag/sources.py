"""The recordings that a recipe reads, made by the lab or supplied by the user."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from slapshot.config.recordings import Recording, StandInRecording
from slapshot.config.sources import Source
from slapshot.dag.simulation import rig_labels
from slapshot.errors import reading
from slapshot.validation import ProblemAtError
from slapshot.yaml_file import Loc

_NEEDED = ("recording.json", "hits.parquet")  # without which a folder holds no recording


@dataclass(frozen=True)
class Sources:
    """Description of recordings in a recipe, from which `slapshot.recordings.read` finds their folders.

    Attributes:
        described: recording -> its source.
        roles: lab/<recording>/<rig> -> label of the stand-in's version.
        files: name -> file in the user's own recording folders.
    """

    described: dict[str, Source]
    roles: dict[str, str]
    files: dict[str, Path]

    @classmethod
    def of(
        cls, name: str, recordings: Mapping[str, Recording], wanted: list[str], rigs: int | None = None
    ) -> "Sources":
        """Sources of some recordings of the domain called `name`.

        Args:
            name: of the domain.
            recordings: all recordings of the domain.
            wanted: names of those to read.
            rigs: number of stand-in rigs of each, beginning with the first; None for all.

        Raises:
            ProblemAtError: a folder holds no recording.
            InputError: a file of it cannot be read.
        """
        described: dict[str, Source] = {}
        roles: dict[str, str] = {}
        files: dict[str, Path] = {}
        for recording in wanted:
            own = recordings[recording]
            if own.path is None:
                stand_in = StandInRecording.from_parts(own)
                labels = rig_labels(name, recording, stand_in)[:rigs]
                roles |= {f"lab/{recording}/{rig}": label for rig, label in enumerate(labels)}
                described[recording] = Source(rigs=len(labels))
            else:
                loc = ("domains", name, "recordings", recording, "path")
                found = _recording_files(own.path, loc)
                files |= {f"{recording}/{file}": path for file, path in found.items()}
                described[recording] = Source(path=own.path)
        return cls(described, roles, files)


def _recording_files(path: str, loc: Loc) -> dict[str, Path]:
    """Files of a recording by name.

    Raises:
        ProblemAtError: there is no such folder, or it holds no recording.
        InputError: a file of it cannot be read.
    """
    folder, remedy = Path(path), "give the path of a recording's folder"
    try:
        files = {p.name: p for p in sorted(folder.iterdir()) if p.suffix in {".json", ".parquet"}}
    except FileNotFoundError:
        raise ProblemAtError(loc, f"{path}: no such folder; {remedy}") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ProblemAtError(loc, f"{path}: cannot be read as a folder ({reason}); {remedy}") from None
    missing = [name for name in _NEEDED if name not in files]
    if missing:
        raise ProblemAtError(
            loc, f"{path} holds no recording, for it has no {' and no '.join(missing)}; {remedy}"
        )
    for file in files.values():
        with reading(file, "a recording's folder holds nothing else that is called so"):
            file.open("rb").close()
    return files
