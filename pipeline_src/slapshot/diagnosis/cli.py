"""`slapshot diagnose RECORDING --rig RIG.yaml --out DIR` for joints and bodies: from files to files."""

import argparse
import hashlib
import os
import sys
from importlib.metadata import version
from pathlib import Path

from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.model.rig_file import RigFile, bound_rig, read_rig_file, rig_of_model
from slapshot.diagnosis.outputs import write_outputs
from slapshot.diagnosis.report.terminal import terminal_text
from slapshot.diagnosis.verdict import versioned
from slapshot.effects.joints.catalogue import import_joint_effects
from slapshot.errors import InputError, check_writable, writing
from slapshot.memory import keep_freed_memory
from slapshot.progress import Steps
from slapshot.recordings.signal_quality import quality_warning_lines
from slapshot.recordings.signals import read_signals
from slapshot.store.code_dependencies import code_digest
from slapshot.store.content import content_digest
from slapshot.text import printable


def run_diagnose(args: argparse.Namespace) -> int:
    """Diagnose and write the report; 0 for a verdict of any kind, 1 where a part of the report failed.

    Raises:
        InputError: something that was given is not there or not allowed.
    """
    if args.out.exists() or args.out.is_symlink():
        raise InputError(f"{args.out}: exists already; name a folder that does not, or remove it")
    check_writable(args.out)
    keep_freed_memory()
    file = _rig(args)
    for module, where in file.effects.items():
        import_joint_effects(module, where)
    recording = read_signals(args.recording)
    rig, recording = bound_rig(file, recording)
    print(
        f"diagnosing {args.recording}: {len(recording.episodes)} episodes, "
        f"{len(rig.observations)} observed channels",
        file=sys.stderr,
    )
    with Steps() as steps:
        diagnosis = diagnose(
            recording, rig, seed=args.seed, threads=os.cpu_count() or 1,
            findings=quality_warning_lines(recording), report=steps,
        )  # fmt: skip
    versions = {
        "slapshot": version("slapshot"),
        "code": code_digest("slapshot.diagnosis.diagnose")[:12],
        "model": hashlib.sha256(file.model.read_bytes()).hexdigest()[:12],
        "recording": _recording_digest(args.recording),
    }
    verdict = versioned(diagnosis.verdict, versions)
    with writing(args.out):
        args.out.mkdir(parents=True)
        problems = write_outputs(diagnosis, verdict, recording, args.out)
    print(terminal_text(verdict))
    for problem in problems:
        print(f"slapshot: {printable(problem)}; all else is in {args.out}", file=sys.stderr)
    return 1 if problems else 0


def _rig(args: argparse.Namespace) -> RigFile:
    if args.rig is not None and args.model is not None:
        raise InputError("--rig and --model were both given; keep the one that describes this robot")
    if args.rig is not None:
        return read_rig_file(args.rig)
    if args.model is not None:
        return rig_of_model(args.model)
    raise InputError(
        "a recording of joints or bodies needs its model: give --model MODEL.xml (MJCF or URDF), "
        "or --rig RIG.yaml"
    )


def _recording_digest(folder: Path) -> str:
    files = sorted(path for path in folder.iterdir() if path.suffix in {".parquet", ".json"})
    text = "".join(f"{path.name}:{content_digest(path)}\n" for path in files)
    return hashlib.sha256(text.encode()).hexdigest()[:12]
