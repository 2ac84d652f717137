"""Recordings as tasks: their latents, what counts as a task, and how its hits are split."""

import json
from typing import Any

import numpy as np
import pandas as pd
import pytest
from slapshot.adaptation.recorded import hit_latents, recorded_tasks, split_hits
from slapshot.config.sources import RecordedTasksSettings
from slapshot.errors import InputError
from slapshot.recordings.format import Recording

HITS = 24  # of each object of a made-up rig (conftest.py)


def settings_of(config: dict[str, Any]) -> RecordedTasksSettings:
    """What a stage is told of recordings, without the rest."""
    values = {name: config[name] for name in RecordedTasksSettings.model_fields}
    return RecordedTasksSettings.model_validate_json(json.dumps(values))


@pytest.fixture
def make(rig):
    def make(latents, model="abc", commands=True, shift=0.0) -> Recording:
        times = np.arange(0, rig.model.sizes.duration, 0.01)
        tables = []
        for hit, latent in enumerate(latents):
            q = rig.model.motion(latent).position(times) + shift
            tables.append(pd.DataFrame({f"q{i}": q[:, i] for i in range(7)}).assign(hit=hit, t=times))
        hits = pd.DataFrame({"hit": range(len(latents)), "latent": list(latents)})
        return Recording(
            rig="test", objects={}, camera_rate_hz=30.0, frame_note="", stand_in=True, trajectory_model=model,
            note="", sealed_truth_sha256=None, hits=hits, tracks=None,
            commands=pd.concat(tables) if commands else None, joints=None,
        )  # fmt: skip

    return make


def test_latents_of_this_model_are_taken_as_they_are(make, rig, tmp_path):
    latents = rig.swings.latents[:3]
    assert hit_latents(make(latents, commands=False), rig.model, "abc", tmp_path) == pytest.approx(latents)


def test_commands_are_encoded_when_latents_are_another_model_s(make, rig, tmp_path):
    latents = rig.swings.latents[:5]
    encoded = hit_latents(make(latents, model="other"), rig.model, "abc", tmp_path)
    expected = rig.model.latents(rig.model.waypoints(latents))
    # Commands every 10 ms are interpolated linearly between waypoints 50 ms apart.
    assert encoded == pytest.approx(expected, abs=0.05)


def test_neither_latents_nor_commands_is_a_clear_error(make, rig, tmp_path):
    with pytest.raises(InputError, match=r"no commands\.parquet to encode"):
        hit_latents(make(rig.swings.latents[:2], "other", commands=False), rig.model, "abc", tmp_path)


def test_commands_that_the_model_cannot_make_are_refused(make, rig, tmp_path):
    with pytest.raises(InputError, match="rad from anything that trajectory model abc can do"):
        hit_latents(make(rig.swings.latents[:2], "other", shift=0.8), rig.model, "abc", tmp_path)


def test_queries_share_no_command_with_adaptation_hits():
    commands = pd.array([0, 0, 0, 1, 1, 2, 3, 4, 5, None, None, 6], dtype="Int64")
    hits = pd.DataFrame({"command_id": commands})
    adapt, query = split_hits(hits, 5, 50, np.random.default_rng(0), "here")
    for a, q in zip(adapt, query, strict=True):
        assert len(a) == len(set(a)) == 5
        assert not set(a) & set(q)
        known = commands.isna()
        assert not set(commands[a][~known[a]]) & set(commands[q][~known[q]])
    assert len({tuple(a) for a in adapt}) > 40


def test_too_few_hits_are_a_clear_error():
    hits = pd.DataFrame({"command_id": pd.array([0, 1, 2], dtype="Int64")})
    with pytest.raises(InputError, match="3 hits with a rest point are too few for 3 samples"):
        split_hits(hits, 3, 1, np.random.default_rng(0), "rig: object red")


def test_splits_depend_on_the_seed_alone():
    hits = pd.DataFrame({"command_id": pd.array(np.arange(30) // 2, dtype="Int64")})
    first, again, other = (split_hits(hits, 5, 3, np.random.default_rng(s), "here") for s in (0, 0, 1))
    for one, same in zip([*first[0], *first[1]], [*again[0], *again[1]], strict=True):
        assert (one == same).all()
    assert any((one != different).any() for one, different in zip(first[0], other[0], strict=True))


def test_every_object_of_every_rig_is_a_task(world):
    config = world.config()
    config["recordings"]["mine"] = {"path": str(world.rigs[1] / "recording")}
    tasks = list(recorded_tasks(settings_of(config), world.inputs()))
    keys = [(task.recording, task.rig, task.object) for task in tasks]
    expected = [("lab", rig, name) for rig in (0, 1) for name in ("red", "blue")]
    assert keys == [*expected, ("mine", 0, "red"), ("mine", 0, "blue")]
    for task, rig in zip(tasks, (0, 0, 1, 1, 1, 1), strict=True):
        hits = world.hits(rig)
        # A hit whose rest point the camera lost is in no task.
        own = hits[(hits["object_id"] == task.object) & hits["rest_x"].notna()]
        assert task.hits["hit"].tolist() == own["hit"].tolist()
        assert len(own) == HITS - (task.object == "red")
        assert task.data["outcome"] == pytest.approx(own[["rest_x", "rest_y"]].to_numpy(), abs=1e-6)
        assert task.data["action"] == pytest.approx(np.stack(own["latent"]), abs=1e-6)
        assert task.stand_in


def test_taken_hits_keep_their_order_and_belong_together(world):
    task = next(recorded_tasks(settings_of(world.config()), world.inputs()))
    rows = np.array([7, 2, 11])
    taken = task.take(rows)
    assert {name: values.shape for name, values in taken.items()} == dict.fromkeys(
        ("state", "action", "outcome"), (1, 3, 2)
    )
    for i, row in enumerate(rows):
        assert taken["outcome"][0, i] == pytest.approx(task.hits.loc[row, ["rest_x", "rest_y"]].tolist())
        assert taken["action"][0, i] == pytest.approx(task.hits.loc[row, "latent"])
