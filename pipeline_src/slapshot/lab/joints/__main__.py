"""`python -m slapshot.lab.joints`: one case of joints as a recording, and apart from it the sealed truth.

The folder gets recording/ (format 2), model.xml (nominal MJCF), rig.yaml (which names it), and
sealed/truth.json. All but the last are for a diagnosis.
"""

import argparse
import sys
from pathlib import Path

from slapshot.errors import InputError, check_writable, writing
from slapshot.json_types import JsonObject
from slapshot.lab.joints.case_spec import CaseSpec, MeasurementCondition
from slapshot.lab.joints.cases import read_cases
from slapshot.lab.joints.noise import CORRELATION
from slapshot.lab.joints.record_case import SIZES
from slapshot.lab.joints.registry import HIDDEN_EFFECTS
from slapshot.lab.joints.rigs import RIGS
from slapshot.lab.joints.stage_case import record
from slapshot.whole_file import replacing

LIST = Path("config/cases/joints.csv")


def write_case(spec: CaseSpec, out: Path) -> JsonObject:
    """Make a case and write it, whole or not at all; returns the truth.

    Raises:
        InputError: the case is not possible, or `out` exists or cannot be written.
    """
    if out.exists():
        raise InputError(f"{out}: exists already; name another folder or remove it")
    check_writable(out)
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        with replacing(out) as aside:
            aside.mkdir()
            return record(spec, aside)


def _order(args: argparse.Namespace) -> CaseSpec:
    if args.case is not None:
        cases = {case.case: case.spec for case in read_cases(args.list)}
        if args.case not in cases:
            raise InputError(f"--case {args.case}: is not in {args.list}; name one of its {len(cases)} cases")
        return cases[args.case]
    if args.seed is None:
        raise InputError("--seed is missing; give a number, of which everything is drawn")
    return CaseSpec(
        rig=args.rig,
        seed=args.seed,
        conceals=tuple((kind, args.size) for kind in filter(None, args.kinds.split(","))),
        condition=MeasurementCondition(args.noise, args.cluttered, args.quantised),
        episodes=args.episodes,
        seconds=args.seconds,
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.lab.joints", description=__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--case", help="name of a row of the list")
    what.add_argument("--rig", choices=RIGS)
    parser.add_argument("--list", type=Path, default=LIST, help=f"of cases (default: {LIST})")
    parser.add_argument("--kinds", default="", help=f"separated by commas: {', '.join(HIDDEN_EFFECTS)}")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--size", type=float, help=f"over the noise; drawn from {SIZES} if left out")
    parser.add_argument("--noise", choices=CORRELATION, default="white")
    parser.add_argument("--cluttered", action="store_true")
    parser.add_argument("--quantised", type=float, help="step of the encoders, rad")
    parser.add_argument("--episodes", type=int, default=CaseSpec.episodes)
    parser.add_argument("--seconds", type=float, default=CaseSpec.seconds)
    parser.add_argument("--out", type=Path, required=True, help="folder that does not exist yet")
    args = parser.parse_args()
    try:
        write_case(_order(args), args.out)
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
