"""Writes the lock beside it: every package at one version with the hashes of its files.

    python requirements/compile.py              # what pyproject.toml asks for; keeps versions where it can
    python requirements/compile.py --upgrade    # newest versions

It needs uv. What is written holds for Linux (x86_64, aarch64) and macOS 14 or newer (arm64), with Python 3.11
and 3.12: for all of these every package but connection-pool (pure Python) comes as a wheel. torch-cpu.txt is
kept by hand.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

FOLDER = Path(__file__).parent
COMPILE = (
    *("uv", "pip", "compile", "--quiet", "--universal", "--python-version", "3.11", "--generate-hashes"),
    *("--no-header", "--no-annotate", "--no-emit-index-url", "--no-emit-find-links"),
    *("--extra", "dev", "pyproject.toml", "-"),
)
EXTRAS = ("benchmark", "docs", "slurm")
BUILD = ("pip", "setuptools")
CUDA = ("cuda-", "nvidia-", "triton==")
HEADERS = {
    "build.txt": "What installs the rest: pip install --require-hashes -r requirements/build.txt",
    "lock.txt": "All that slapshot needs, its tests included, but CUDA: see the Makefile.",
    "cuda.txt": "Constraints: what the package index's torch needs on Linux; that for CPUs alone does not.",
    "benchmark.txt": "What the peer of `snakemake benchmark` needs beside lock.txt.",
    "docs.txt": "What `make docs` needs beside lock.txt.",
    "slurm.txt": "What profiles/slurm needs beside lock.txt.",
}


def main() -> None:
    """Compile and write the files of HEADERS."""
    files = [FOLDER / name for name in HEADERS]
    before = "".join(file.read_text() for file in files if file.is_file())
    everything = compiled(before, *(option for extra in EXTRAS for option in ("--extra", extra)))
    needed = compiled("".join(everything.values()))
    needed_by = {extra: compiled("".join(everything.values()), "--extra", extra) for extra in EXTRAS}
    texts = dict.fromkeys(HEADERS, "")
    for name, block in everything.items():
        if name in BUILD:
            file = "build.txt"
        elif block.startswith(CUDA):
            file = "cuda.txt"
        elif name in needed:
            file = "lock.txt"
        else:
            file = next(f"{extra}.txt" for extra in EXTRAS if name in needed_by[extra])
        texts[file] += block
    for name, text in texts.items():
        (FOLDER / name).write_text(f"# Written by requirements/compile.py. {HEADERS[name]}\n{text}")


def compiled(before: str, *options: str) -> dict[str, str]:
    """Package -> its lines.

    Args:
        before: lines of versions that are kept where they can be.
        options: of uv.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "lock.txt"
        out.write_text(before)
        command = [*COMPILE, *options, *sys.argv[1:], "--output-file", str(out)]
        subprocess.run(command, check=True, text=True, input="\n".join(BUILD), cwd=FOLDER.parent)
        blocks = re.split(r"^(?=\w)", out.read_text(), flags=re.MULTILINE)
    lines: dict[str, str] = {}
    for block in filter(str.strip, blocks):
        name = re.split("[=[]", block)[0]
        lines[name] = lines.get(name, "") + block  # a version for each Python, where no one serves both
    return lines


if __name__ == "__main__":
    main()
