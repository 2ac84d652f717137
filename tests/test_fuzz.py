"""Configurations, rig files, import mappings and verdicts changed at random: refused in one line, or read.

Seeded: a number that fails is the seed of its case. Recordings have a fuzzer of their own
(recordings/test_fuzz.py).
"""

import copy
import json
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from slapshot.config.files import read_config
from slapshot.diagnosis.pucks.rig_file import read_rig
from slapshot.diagnosis.pucks.verdict_file import VERDICT_FILE, read_verdict
from slapshot.errors import InputError
from slapshot.recordings.importing.mapping import load_mapping
from slapshot.recordings.importing.signal_mapping import load_signal_mapping

ROOT = Path(__file__).parents[1]
CASES, TOGETHER = 160, 40
# What no door takes for a value of another kind: read_* must refuse them, or say that they are allowed there.
NASTY: list[Any] = [
    None, True, 0, -1, 1e300, -1e300, 1e-300, 2**70, "", " ", "-rf", "a" * 5000, "\x1b[31m", "x\ny", "../..",
    "1e-3", "ä" * 40,
    [], [[]], {}, {"": 0}, [1, "a"], "yes", "NaN", "2026-11-22", "{file}", "%n", "~", "\u202e",
]  # fmt: skip
VERDICT: dict[str, Any] = {
    "headline": "cannot_tell",
    "rig": "rig",
    "kind": "tracks only",
    "stand_in": True,
    "hits": 9,
    "used": 3,
    "cannot_tell": "only 3 hits can be used; record at least 12",
    "hits_to_blame": [3],
    "findings": ["only 9 hits"],
    **dict.fromkeys(("mismatch", "location", "unknown", "noise_sd_m", "noise_time_s", "noise_jitter_s")),
    **dict.fromkeys(("friction_scatter", "fit")),
    "effects": [],
    "limits": [{"effect": "tilt", "parameter": "slope_x", "unit": "m/m", "at_most": 0.1}],
    "next_hits": [],
    "notes": ["none"],
    "versions": {"code": "1"},
}

Door = tuple[str, Callable[[Path], Any], dict[str, Any]]


def doors() -> Iterator[Any]:
    config = yaml.safe_load((ROOT / "config/tiny.yaml").read_text())
    yield pytest.param(("c.yaml", lambda file: read_config([file]), config), id="configuration")
    rig = yaml.safe_load((ROOT / "config/rigs/lasa-table.yaml").read_text())
    yield pytest.param(("r.yaml", read_rig, rig), id="rig file")
    mapping = yaml.safe_load((ROOT / "config/recordings/lasa-hits.yaml").read_text())
    yield pytest.param(("m.yaml", load_mapping, mapping), id="import mapping")
    signals = yaml.safe_load((ROOT / "config/recordings/pendulum-double-sysid.yaml").read_text())
    yield pytest.param(("s.yaml", load_signal_mapping, signals), id="mapping of signals")
    yield pytest.param((VERDICT_FILE, lambda file: read_verdict(file.parent), VERDICT), id="verdict")


def places(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in nested mappings and lists, but for the whole."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inside:
        yield (*place, key)
        yield from places(item, (*place, key))


def changed(values: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """One or two values replaced, lost, renamed, wrapped or moved elsewhere."""
    values = copy.deepcopy(values)
    for _ in range(rng.integers(1, 3)):
        all_places = list(places(values))
        if not all_places:
            break
        *above, last = all_places[rng.integers(len(all_places))]
        holder: Any = values
        for key in above:
            holder = holder[key]
        how = rng.integers(6)
        if how == 0:
            del holder[last]
        elif how == 1 and isinstance(holder, dict):
            holder[f"{last}x"] = holder.pop(last)
        elif how == 2:
            holder[last] = [holder[last]]
        elif how == 3:
            holder[last] = {"value": holder[last]}
        else:
            holder[last] = copy.deepcopy(NASTY[rng.integers(len(NASTY))])
    return values


def damaged(text: str, rng: np.random.Generator) -> str:
    """The file itself cut short, or with a character changed, in one case of five."""
    if rng.random() < 0.8:
        return text
    at = int(rng.integers(1, len(text)))
    return (
        text[:at]
        if rng.random() < 0.4
        else text[:at] + str(rng.choice(list("{}[]:,\"'\t\0&*!x"))) + text[at + 1 :]
    )


@pytest.mark.parametrize("first", range(0, CASES, TOGETHER))
@pytest.mark.parametrize("door", tuple(doors()))
def test_what_is_changed_is_refused_in_one_line_or_read(
    door: Door, first: int, tmp_path, monkeypatch
) -> None:
    monkeypatch.chdir(ROOT)
    name, read, good = door
    file = tmp_path / name
    refused = 0
    for seed in range(first, first + TOGETHER):
        rng = np.random.default_rng(seed)
        values = changed(good, rng)
        text = json.dumps(values) if name.endswith(".json") else yaml.safe_dump(values, allow_unicode=True)
        file.write_text(damaged(text, rng), "utf-8")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                read(file)
        except InputError as error:
            said = str(error)
            assert said.isprintable(), seed
            assert len(said) < 1000, seed
            refused += 1
        except Exception as error:
            raise AssertionError(f"seed {seed}: {type(error).__name__}: {error}") from error
    # Most changes are mistakes; a door that lets them in is open.
    assert refused > TOGETHER // 2
