import os
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from slapshot.command import Run, make_version
from slapshot.config.rollouts import RolloutsSettings
from slapshot.rollouts import plan as plan_module
from slapshot.rollouts.__main__ import produce
from slapshot.rollouts.dataset import ROWS_PER_GROUP, concatenate, hits_schema
from slapshot.rollouts.reading import read_sequences
from slapshot.store.content import content_digest
from slapshot.store.folder import Store
from slapshot.store.recipe import Recipe
from slapshot.trajectories.swings import SPLITS
from slapshot.validation import values_of
from waiting import started


@pytest.fixture(scope="module")
def settings(hockey_config):
    sizes = {"train": 24, "validation": 4, "test": 2, "hits": 16, "track_share": 0.1}
    randomisation = hockey_config.randomisation
    return values_of(
        RolloutsSettings.from_parts(
            hockey_config.rollouts, domain="hockey", seed=5, randomisation=randomisation, **sizes
        )
    )


def run(rig, settings, out: Path, cores: int = 2) -> Path:
    out.mkdir(exist_ok=True)
    produce(Run(settings, rig.folders, out, cores))
    return out


def digests(folder: Path) -> dict[str, str]:
    return {p.name: content_digest(p) for p in sorted(folder.iterdir()) if p.is_file()}


@pytest.fixture(scope="module")
def dataset(rig, settings, tmp_path_factory) -> Path:
    return run(rig, settings, tmp_path_factory.mktemp("data") / "whole", cores=2)


def test_content_does_not_depend_on_cores_or_shards(rig, settings, dataset, tmp_path, monkeypatch):
    monkeypatch.setattr(plan_module, "HITS_PER_SHARD", 50)
    assert digests(run(rig, settings, tmp_path / "one", cores=1)) == digests(dataset)


def test_splits_are_disjoint(dataset, rig):
    tables = {s: pq.read_table(dataset / f"hits-{s}.parquet").to_pandas() for s in SPLITS}
    actions = {s: set(map(tuple, t["action"])) for s, t in tables.items()}
    assert len(set.union(*actions.values())) == sum(map(len, actions.values()))
    conditions = pd.read_parquet(dataset / "conditions.parquet")
    drawn = conditions[conditions["name"] == ""]
    assert not drawn.duplicated(subset=["mass", "friction_x"]).any()
    for split, table in tables.items():
        assert set(table["swing"]) <= set(rig.swings.of_split(split))
        assert len(table) == 16 * (conditions["split"] == split).sum()


def test_hits_carry_what_made_them(dataset, rig, settings):
    table = pq.read_table(dataset / "hits-train.parquet")
    assert all(field.metadata[b"unit"] for field in table.schema)
    frame = table.to_pandas()
    latents = rig.swings.latents[frame["swing"]].astype(np.float32)
    assert np.array_equal(np.stack(frame["action"]), latents)
    errors = frame[["start_error_x", "start_error_y"]].to_numpy()
    assert errors.std() == pytest.approx(0.02, rel=6 / np.sqrt(2 * errors.size))
    assert np.isfinite(np.stack(frame["outcome"])).all()


def test_tracks_are_of_the_configured_share(dataset, settings):
    tracks = pq.read_table(dataset / "tracks.parquet").to_pandas()
    count = len(tracks.drop_duplicates(subset=["split", "condition", "hit"]))
    total = 16 * len(pd.read_parquet(dataset / "conditions.parquet"))
    assert abs(count - 0.1 * total) < 6 * np.sqrt(0.1 * 0.9 * total)


def test_named_conditions_are_in_the_test_split(dataset, settings):
    conditions = pd.read_parquet(dataset / "conditions.parquet").set_index("name")
    for name, values in settings["named_conditions"].items():
        row = conditions.loc[name]
        assert row["split"] == "test"
        for parameter, value in values.items():
            assert row[parameter] == value


def test_sequences_are_by_condition(dataset):
    data = read_sequences(dataset, "validation")
    frame = pq.read_table(dataset / "hits-validation.parquet").to_pandas()
    assert data.outcome.shape == (4, 16, 2)
    second = frame[frame["condition"] == 1]
    assert np.array_equal(data.outcome[1], np.stack(second["outcome"]))


def test_killed_run_resumes_to_the_same_content(rig, settings, dataset, tmp_path, monkeypatch):
    """SIGKILL while shards are written, then again, then to the end."""
    store = Store(tmp_path / "store")
    upstream = {}
    for role in ("scene", "swings"):
        recipe = Recipe(role, {}, "code")
        with store.new_version(recipe) as out:
            for file in rig.folders[role].iterdir():
                os.link(file, out / file.name)
        upstream[role] = (role, recipe.id)
    recipe = Recipe("rollouts", settings, "code", upstream)
    partial = store.root / "rollouts" / f".partial-{recipe.id}"
    code = (
        "import sys; from slapshot.rollouts import plan; plan.HITS_PER_SHARD = 32\n"
        "from threading import Event; from slapshot.command import stage_command\n"
        "from slapshot.rollouts import __main__ as stage\n"
        "stage._join = lambda *_: Event().wait()  # it does not end before it is killed\n"
        "stage_command('rollouts', stage.produce, resume=True)"
    )
    command = [sys.executable, "-c", code, "--recipe", recipe.to_json(), "--store", str(store.root)]

    def shards() -> int:
        return len(list(partial.glob("parts/tracks-*.parquet")))

    for wanted in (2, 5):
        with started(*command, output=tmp_path / "output.txt") as running:
            running.wait_until(lambda wanted=wanted: shards() >= wanted, f"{wanted} shards are there")
        assert not store.is_whole("rollouts", recipe.id)
    before = {p: p.stat().st_mtime_ns for p in partial.glob("parts/*.parquet")}
    monkeypatch.setattr(plan_module, "HITS_PER_SHARD", 32)
    kept = []

    def watch(run: Run) -> None:
        kept.extend(p for p, t in before.items() if p.exists() and p.stat().st_mtime_ns == t)
        produce(run)

    folder = make_version(store, recipe, watch, cores=1, resume=True)
    found = digests(folder)
    del found["version.json"]
    assert found == digests(dataset)
    assert len(kept) >= 10
    assert not list(folder.glob("parts")) + list(folder.glob(".joined"))


def test_joining_keeps_order_and_bounds_row_groups(tmp_path):
    schema = hits_schema(3)
    rows = ROWS_PER_GROUP // 2 + 100
    parts = []
    for i in range(3):
        columns = []
        for field in schema:
            if pa.types.is_fixed_size_list(field.type):
                flat = pa.array(np.full(rows * field.type.list_size, i, np.float32))
                columns.append(pa.FixedSizeListArray.from_arrays(flat, type=field.type))
            else:
                columns.append(pa.array(np.full(rows, i)).cast(field.type))
        parts.append(tmp_path / f"{i}.parquet")
        pq.write_table(pa.table(columns, schema=schema), parts[-1])
    concatenate(parts, tmp_path / "all.parquet", schema)
    with pq.ParquetFile(tmp_path / "all.parquet") as file:
        sizes = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
        assert max(sizes) <= ROWS_PER_GROUP
        assert np.array_equal(file.read()["condition"], np.repeat([0, 1, 2], rows))
