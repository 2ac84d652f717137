"""Examples of the documentation, run as a reader would."""

import re
import runpy
from pathlib import Path

EXAMPLE = Path(__file__).parents[1] / "docs/examples/diagnose_arrays.py"


def test_the_library_finds_the_friction_of_the_example(capsys):
    made = runpy.run_path(str(EXAMPLE))
    made["main"]()
    headline, *effects = capsys.readouterr().out.splitlines()
    assert headline == "found"
    assert [line.split(":")[0] for line in effects] == ["coulomb_friction"]
    value, low, high = (float(number) for number in re.findall(r"\d\.\d{4}", effects[0]))
    # A 90 % interval may miss by chance; twice its half-width misses in 1 of 1,000 draws.
    assert abs(value - made["FRICTION"]) < high - low
