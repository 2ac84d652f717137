"""`slapshot diagnose RECORDING --out DIR`: from files to files."""

import argparse
import hashlib
import os
import sys
from importlib.metadata import version
from pathlib import Path

from slapshot.config.files import load_config
from slapshot.diagnosis.pucks.diagnose import diagnose
from slapshot.diagnosis.pucks.launch.signatures import Signatures
from slapshot.diagnosis.pucks.outputs import write_outputs
from slapshot.diagnosis.pucks.report import terminal_text
from slapshot.diagnosis.pucks.result import Diagnosis
from slapshot.diagnosis.pucks.rig_file import RigFile, read_rig, rig_of_domain
from slapshot.effects.catalogue import import_effects
from slapshot.errors import InputError, check_writable, writing
from slapshot.recordings.read import read_recording
from slapshot.scenes.scene import Scene
from slapshot.store.code_dependencies import code_digest
from slapshot.store.content import content_digest
from slapshot.text import printable
from slapshot.whole_file import replacing


def run_diagnose(args: argparse.Namespace) -> int:
    """Diagnose and write the report; 0 for a verdict of any kind, 1 where a part of the report failed.

    Raises:
        InputError: something that was given is not there or not allowed.
    """
    if args.out.exists() or args.out.is_symlink():
        raise InputError(f"{args.out}: exists already; name a folder that does not, or remove it")
    check_writable(args.out)
    if args.signatures is not None and args.out.absolute() in (
        args.signatures.absolute(),
        *args.signatures.absolute().parents,
    ):
        raise InputError(f"--signatures {args.signatures}: lies in --out {args.out}; name a file elsewhere")
    rig = _rig(args)
    for module, where in rig.effects.items():
        import_effects(module, where=where)
    recording = read_recording(args.recording)
    signatures = _signatures(args.signatures, rig.scene)
    print(f"diagnosing {args.recording}: {len(recording.hits)} hits, {recording.kind}", file=sys.stderr)
    diagnosis = diagnose(
        recording, rig.setting, args.seed, threads=os.cpu_count() or 1, signatures=signatures
    )
    versions = {
        "slapshot": version("slapshot"),
        "code": code_digest("slapshot.diagnosis.pucks.diagnose")[:12],
        "scene": _digest(rig.scene.xml),
        "recording": _recording_digest(args.recording),
    }
    problems: tuple[str, ...] = ()
    try:
        _keep(diagnosis, args.signatures, signatures, rig.scene)
    except InputError as error:  # a verdict is not lost for them
        problems = (str(error),)
    with writing(args.out):
        args.out.mkdir(parents=True)
        problems += write_outputs(diagnosis, recording, rig.scene, versions, args.out)
    print(terminal_text(diagnosis.verdict))
    for problem in problems:
        print(f"slapshot: {printable(problem)}; all else is in {args.out}", file=sys.stderr)
    return 1 if problems else 0


def _rig(args: argparse.Namespace) -> RigFile:
    if args.rig is not None:
        return read_rig(args.rig)
    domains = load_config(args.config).domains
    if args.domain not in domains:
        raise InputError(f"--domain: no domain {args.domain!r}; use one of: {', '.join(domains)}")
    return rig_of_domain(domains[args.domain])


def _signatures(file: Path | None, scene: Scene) -> Signatures | None:
    """What the file holds, if it is there.

    Raises:
        InputError: it is no such file or of another scene, or it could not be written later.
    """
    if file is None:
        return None
    if not (file.exists() or file.is_symlink()):
        check_writable(file)
        return None
    return Signatures.load(file, scene)


def _keep(diagnosis: Diagnosis, file: Path | None, before: Signatures | None, scene: Scene) -> None:
    """Save signatures that were made, for the next recording over these commands."""
    if file is not None and diagnosis.signatures is not None and diagnosis.signatures is not before:
        with writing(file):
            file.parent.mkdir(parents=True, exist_ok=True)
            with replacing(file) as aside:
                diagnosis.signatures.save(aside, scene)


def _recording_digest(folder: Path) -> str:
    files = sorted(path for path in folder.iterdir() if path.suffix in {".parquet", ".json"})
    return _digest("".join(f"{path.name}:{content_digest(path)}\n" for path in files))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]
