"""The recordings that a recipe reads, made by the lab or of one's own."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slapshot.errors import InputError
from slapshot.plan.simulation import rig_labels


@dataclass(frozen=True)
class Sources:
    """What a recipe says of recordings; `slapshot.recordings.sources` finds their folders from it.

    Attributes:
        described: recording -> {"rigs": count} of a stand-in, or {"path": folder}.
        roles: lab/<recording>/<rig> -> label of the stand-in's version.
        files: what the folders of one's own hold.
    """

    described: dict[str, Any]
    roles: dict[str, str]
    files: dict[str, Path]

    @classmethod
    def of(cls, name: str, domain: Mapping[str, Any], recordings: list[str]) -> "Sources":
        """Sources of some recordings of the domain called `name`.

        Raises:
            InputError: a folder holds no recording.
        """
        described: dict[str, Any] = {}
        roles: dict[str, str] = {}
        files: dict[str, Path] = {}
        for recording in recordings:
            settings = domain["recordings"][recording]
            if "lab" in settings:
                labels = rig_labels(name, recording, settings)
                roles |= {f"lab/{recording}/{rig}": label for rig, label in enumerate(labels)}
                described[recording] = {"rigs": settings["rigs"]}
            else:
                key = f"domains.{name}.recordings.{recording}.path"
                found = _recording_files(settings["path"], key)
                files |= {f"{recording}/{file}": path for file, path in found.items()}
                described[recording] = {"path": settings["path"]}
        return cls(described, roles, files)


def _recording_files(path: str, key: str) -> dict[str, Path]:
    folder = Path(path)
    files = {p.name: p for p in sorted(folder.glob("*")) if p.suffix in {".json", ".parquet"}}
    if not files:
        raise InputError(
            f"{key}: {path} holds no recording (recording.json, hits.parquet, ...); "
            "give the path of a recording's folder"
        )
    return files


def check_names(name: str, block: str, domain: Mapping[str, Any]) -> None:
    """Whether the recording and the method that a block of a domain names are the domain's.

    Raises:
        InputError: one of them is not.
    """
    for key, known in (("recording", domain["recordings"]), ("method", domain["methods"])):
        if domain[block][key] not in known:
            raise InputError(
                f"domains.{name}.{block}.{key}: {domain[block][key]!r} is not among domains.{name}.{key}s; "
                f"use one of: {', '.join(known)}"
            )
