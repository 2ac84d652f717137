"""The `slapshot` command, on a made-up store and a copy of the configuration."""

import functools
import json
import shutil
from pathlib import Path

import pytest
from recordings.builder import make_recording
from slapshot import cli
from slapshot.config.files import load_config
from slapshot.dag import make_plan
from slapshot.recordings.write import write_recording
from slapshot.store.code_dependencies import code_digest, imported_libraries
from slapshot.store.folder import Store
from slapshot.store.recipe import Recipe

ROOT = Path(__file__).parents[1]
TINY = Path("config/tiny.yaml")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    """A working copy with configurations and an empty store; the current folder."""
    shutil.copytree(ROOT / "config", tmp_path / "config")
    shutil.copytree(ROOT / "workflow/schemas", tmp_path / "workflow/schemas")
    monkeypatch.chdir(tmp_path)
    return tmp_path


_digest_once = functools.cache(code_digest)
_libraries_once = functools.cache(imported_libraries)


@pytest.fixture(autouse=True)
def unchanged_code(monkeypatch):
    """No test here edits code, and to follow all imports takes most of the time of a plan."""
    monkeypatch.setattr("slapshot.store.recipe.code_digest", _digest_once)
    monkeypatch.setattr("slapshot.store.recipe.imported_libraries", _libraries_once)


@pytest.fixture
def slapshot(monkeypatch, capsys):
    """Runs the command; returns exit code, output and errors."""

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["slapshot", *arguments])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        captured = capsys.readouterr()
        return caught.value.code or 0, captured.out, captured.err

    return run


def recipes(config: Path | None = None) -> dict[str, Recipe]:
    return make_plan(load_config(config)).of_figures()


def fill(config: Path | None = None, store: Path = Path("data/store")) -> dict[str, Recipe]:
    """Makes every version of a configuration, with a little text in it."""
    made = recipes(config)
    for recipe in made.values():
        if not Store(store).is_whole(recipe.stage, recipe.id):
            with Store(store).new_version(recipe) as out:
                (out / "payload.csv").write_text("x\n1\n2\n")
    return made


def change_default(old: str, new: str) -> None:
    file = Path("config/default.yaml")
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def one_line(errors: str) -> str:
    assert errors.startswith("slapshot: ")
    assert errors.count("\n") == 1
    return errors


def test_list_names_every_version_and_what_it_is_from(slapshot):
    assert slapshot("versions", "list")[0] == 0
    made = fill()
    code, out, _ = slapshot("versions", "list")
    assert code == 0
    lines = [line.split() for line in out.splitlines()]
    assert {(words[0], words[1]) for words in lines[1:]} == {(r.stage, r.id) for r in made.values()}
    train = next(r for r in made.values() if r.stage == "train")
    line = next(words for words in lines if words[:2] == ["train", train.id])
    assert line[-1] == f"rollouts/{train.upstream['rollouts'][1][:6]}"


def test_list_of_another_store(slapshot):
    fill(store=Path("elsewhere"))
    assert len(slapshot("versions", "list", "--store", "elsewhere")[1].splitlines()) > 5
    assert len(slapshot("versions", "list")[1].splitlines()) == 1


def test_versions_go_to_another_store_in_one_file(slapshot):
    made = [recipe for recipe in fill().values() if recipe.stage == "train"]
    code, out, _ = slapshot("versions", "pack", "models.tar.xz", "--stage", "train")
    assert (code, out) == (0, f"models.tar.xz: {len(made)} versions\n")
    Path("elsewhere").mkdir()
    code, out, _ = slapshot("versions", "unpack", "models.tar.xz", "--store", "elsewhere")
    assert (code, out) == (0, f"elsewhere: {len(made)} versions added\n")
    assert all(Store(Path("elsewhere")).is_whole("train", recipe.id) for recipe in made)
    code, _, errors = slapshot("versions", "unpack", "nothing.tar.xz")
    assert code == 1
    assert "nothing.tar.xz is missing" in one_line(errors)


def test_diff_shows_the_keys_that_differ_and_no_others(slapshot):
    default, tiny = fill()["train/hockey/kalman"], fill(TINY)["train/hockey/kalman"]
    code, out, _ = slapshot("versions", "diff", default.id, f"train/{tiny.id[:8]}")
    assert code == 0
    rows = {line.split()[0]: line.split(maxsplit=1)[1] for line in out.splitlines()}
    steps = (default.config["training"]["steps"], tiny.config["training"]["steps"])
    assert rows["config.training.steps"].split() == [str(n) for n in steps]
    assert rows["config.settings.hidden"].split() == ["[128,", "128]", "[48]"]
    assert "upstream.rollouts" in rows
    assert not {"config.method", "stage", "code"} & set(rows)


def test_diff_of_a_version_with_itself(slapshot):
    train = fill()["train/hockey/kalman"]
    assert slapshot("versions", "diff", train.id, train.id)[:2] == (0, "no difference\n")


def test_diff_of_an_unknown_version(slapshot):
    code, _, errors = slapshot("versions", "diff", "abc", "def")
    assert code == 1
    assert "no version in data/store begin with 'abc'; see `slapshot versions list`" in one_line(errors)


def test_why_says_that_a_version_is_there(slapshot):
    made = fill()
    code, out, _ = slapshot("versions", "why", "rollouts")
    expected = [f"rollouts/{d}: {made[f'rollouts/{d}'].id} is there" for d in ("hockey", "fetchslide")]
    assert (code, out.splitlines()) == (0, expected)


def test_why_says_that_there_never_was_one(slapshot):
    rollouts = recipes()["rollouts/hockey"]
    code, out, _ = slapshot("versions", "why", "rollouts")
    assert code == 0
    first, second = out.splitlines()  # a line a domain
    assert first == f"rollouts/hockey: {rollouts.id} is to be made; there is no version of it yet"
    assert second.startswith("rollouts/fetchslide: ")


def test_why_shows_what_changed_since_the_nearest_version(slapshot):
    fill(TINY)
    old = fill()["rollouts/hockey"]
    change_default("track_share: 0.03", "track_share: 0.05")
    new = recipes()["rollouts/hockey"]
    code, out, _ = slapshot("versions", "why", "rollouts")
    assert code == 0
    assert out.splitlines()[0].startswith(f"rollouts/hockey: {new.id} is to be made; the nearest version")
    assert [line.split() for line in out.splitlines()[1:3]] == [
        ["key", old.id, new.id],
        ["config.track_share", "0.03", "0.05"],
    ]


def test_why_of_another_configuration_and_of_several(slapshot):
    fill()
    assert "is to be made" in slapshot("versions", "why", "rollouts", "--config", str(TINY))[1]
    fill(TINY)
    assert "is there" in slapshot("versions", "why", "rollouts", "--config", str(TINY))[1]
    both = slapshot("versions", "why", "rollouts", "--config", str(TINY), "--config", "config/default.yaml")[
        1
    ]
    assert len(both.splitlines()) == 4  # two domains each
    assert "config/default.yaml:rollouts/hockey" in both


def test_why_of_an_unknown_stage(slapshot):
    code, _, errors = slapshot("versions", "why", "training")
    assert code == 1
    assert "no stage 'training'; stages: scene, " in one_line(errors)


def test_gc_lists_and_removes_only_with_yes(slapshot):
    default, tiny = fill(), fill(TINY)
    garbage = {(r.stage, r.id) for r in tiny.values()} - {(r.stage, r.id) for r in default.values()}
    assert garbage
    store = Store(Path("data/store"))
    default_alone = ("versions", "gc", "--config", "config/default.yaml")
    code, out, _ = slapshot(*default_alone)
    assert code == 0
    assert {line.split()[0] for line in out.splitlines()[:-1]} == {f"data/store/{s}/{i}" for s, i in garbage}
    assert out.splitlines()[-1].startswith(f"{len(garbage)} folders, ")
    assert "add --yes" in out
    assert all(store.is_whole(*pair) for pair in garbage)

    code, out, _ = slapshot(*default_alone, "--yes")
    assert code == 0
    assert out.splitlines()[-1].endswith("removed")
    assert not any(store.is_whole(*pair) for pair in garbage)
    assert all(store.is_whole(r.stage, r.id) for r in default.values())
    assert slapshot(*default_alone)[1].startswith("0 folders")


def test_gc_keeps_what_any_shipped_configuration_asks_for_unless_some_are_given(slapshot):
    fill(TINY)
    garbage = Recipe("train", {"from": "nowhere"}, code="0" * 64)
    with Store(Path("data/store")).new_version(garbage) as out:
        (out / "payload").write_text("x")
    code, out, _ = slapshot("versions", "gc", "--yes")
    assert code == 0
    assert out.splitlines()[0].startswith(f"data/store/train/{garbage.id}  ")
    assert out.splitlines()[1].startswith("1 folders, ")
    assert not slapshot("versions", "gc", "--config", "config/default.yaml")[1].startswith("0 folders")


def test_gc_keeps_what_any_of_the_configurations_asks_for(slapshot):
    fill()
    fill(TINY)
    out = slapshot("versions", "gc", "--config", "config/default.yaml", "--config", str(TINY))[1]
    assert out.startswith("0 folders")
    assert not slapshot("versions", "gc", "--config", str(TINY))[1].startswith("0 folders")


def test_gc_with_a_bad_configuration_removes_nothing(slapshot):
    made = fill()
    code, _, errors = slapshot("versions", "gc", "--yes", "--config", "config/nowhere.yaml")
    assert code == 1
    assert "config/nowhere.yaml: no such file" in one_line(errors)
    assert all(Store(Path("data/store")).is_whole(r.stage, r.id) for r in made.values())


def test_lock_then_verify_reproduces(slapshot):
    made = fill()
    code, out, _ = slapshot("versions", "lock")
    assert (code, out) == (0, f"data/pipeline.lock: {len(made)} versions\n")
    code, out, _ = slapshot("versions", "verify")
    assert code == 0
    assert out.splitlines() == [*(f"{label}: identical" for label in sorted(made)), "reproduced"]


@pytest.mark.parametrize(
    ("text", "code", "verdict"),
    [("x\n1.0001\n2.0\n", 0, "equal within tolerance"), ("x\n1\n5\n", 1, "differs: payload.csv: x by")],
)
def test_verify_judges_other_numbers(slapshot, text, code, verdict):
    fill()
    slapshot("versions", "lock")
    label = "figure/hockey/F7"  # nothing is made from it
    lock = json.loads(Path("data/pipeline.lock").read_text())
    recipe = recipes()[label]
    store = Store(Path("data/store"))
    shutil.rmtree(store.folder(recipe.stage, recipe.id))
    with store.new_version(recipe) as out:
        (out / "payload.csv").write_text(text)
    found, said, _ = slapshot("versions", "verify")
    assert found == code
    line = next(line for line in said.splitlines() if line.startswith(f"{label}: "))
    assert line.startswith(f"{label}: {verdict}")
    assert said.splitlines()[-1] == ("not reproduced" if code else "reproduced")
    assert lock == json.loads(Path("data/pipeline.lock").read_text())


def test_verify_finds_what_is_damaged_and_what_is_missing(slapshot):
    made = fill()
    slapshot("versions", "lock")
    store = Store(Path("data/store"))
    train, scene = made["train/hockey/kalman"], made["scene/hockey"]
    (store.folder("train", train.id) / "payload.csv").write_text("x\n1\n3\n")
    shutil.rmtree(store.folder("scene", scene.id))
    code, out, _ = slapshot("versions", "verify")
    assert code == 1
    assert "train/hockey/kalman: damaged: payload.csv" in out
    assert "scene/hockey: not made yet" in out
    assert out.endswith("not reproduced\n")


def test_verify_names_what_was_made_from_another_content(slapshot):
    made = fill()
    slapshot("versions", "lock")
    train = made["train/hockey/kalman"]
    store = Store(Path("data/store"))
    shutil.rmtree(store.folder("train", train.id))
    with store.new_version(train) as out:
        (out / "payload.csv").write_text("x\n1.0001\n2.0\n")
    code, out, _ = slapshot("versions", "verify")
    assert code == 1
    assert "train/hockey/kalman: equal within tolerance" in out
    said = f"evaluate/hockey/kalman: made from another content of train/{train.id} than is there now; run "
    assert said in out
    assert f"claim/hockey/C4: {'identical'}" in out  # made from what is made from it, and that is as it was


def test_verify_of_any_configuration_says_of_each_version_whether_it_is_whole(slapshot):
    verify = ("versions", "verify", "--config", str(TINY))
    code, out, _ = slapshot(*verify)
    assert code == 1
    lines = [*(f"{label}: not made yet" for label in recipes(TINY)), "not all whole"]
    assert sorted(out.splitlines()) == sorted(lines)
    made = fill(TINY)
    ids = {recipe.id for recipe in made.values()}
    labels = [label for label, recipe in make_plan(load_config(TINY)).recipes.items() if recipe.id in ids]
    code, out, errors = slapshot(*verify)
    assert (code, errors) == (0, "")
    assert sorted(out.splitlines()) == sorted([*(f"{label}: whole" for label in labels), "all whole"])
    train = made["train/hockey/kalman"]
    (Store(Path("data/store")).folder("train", train.id) / "payload.csv").write_text("x\n1\n3\n")
    code, out, _ = slapshot(*verify)
    assert code == 1
    assert "train/hockey/kalman: damaged: payload.csv not as written; run `slapshot versions verify" in out
    assert out.endswith("not all whole\n")


def test_verify_checks_what_is_made_on_demand_if_it_is_there(slapshot):
    fill()
    slapshot("versions", "lock")
    plan = make_plan(load_config())
    label = next(label for label in plan.recipes if label in plan.on_demand)
    with Store(Path("data/store")).new_version(plan.recipes[label]) as out:
        (out / "payload").write_text("x")
    assert slapshot("versions", "verify")[0] == 0
    recipe = plan.recipes[label]
    (Store(Path("data/store")).folder(recipe.stage, recipe.id) / "payload").write_text("y")
    code, out, _ = slapshot("versions", "verify")
    assert code == 1
    assert f"{label}: damaged: payload not as written" in out


def test_repair_removes_what_is_damaged_and_what_was_made_from_it_whoever_asks_for_it(slapshot):
    default, tiny = fill(), fill(TINY)
    store = Store(Path("data/store"))
    shared = Recipe("train", {"of": "another configuration"}, code="0" * 64, upstream={
        "rollouts": ("rollouts", tiny["rollouts/hockey"].id)
    })  # fmt: skip
    with store.new_version(shared) as out:
        (out / "payload").write_text("x")
    (store.folder("rollouts", tiny["rollouts/hockey"].id) / "payload.csv").write_text("x\n1\n3\n")
    code, out, errors = slapshot("versions", "verify", "--repair", "--config", str(TINY))
    assert (code, errors) == (0, "")
    assert not store.is_whole("rollouts", tiny["rollouts/hockey"].id)
    assert not store.is_whole("train", shared.id)
    assert f"removed train/{shared.id}: made from rollouts/{tiny['rollouts/hockey'].id}" in out
    count = len([line for line in out.splitlines() if line.startswith("removed ")])
    assert out.splitlines()[-1] == f"{count} versions removed"
    assert all(store.is_whole(recipe.stage, recipe.id) for recipe in default.values())
    assert store.is_whole("swings", tiny["swings/hockey"].id)
    fill(TINY)
    assert slapshot("versions", "verify", "--config", str(TINY))[1].endswith("all whole\n")
    code, out, _ = slapshot("versions", "verify", "--repair", "--config", str(TINY))
    assert (code, out) == (0, "nothing is damaged\n")


@pytest.mark.parametrize("command", [("list",), ("why", "train"), ("diff", "TRAIN", "TRAIN")])
def test_a_damaged_version_file_is_one_line_and_the_others_are_used(slapshot, command):
    made = fill()
    store = Store(Path("data/store"))
    scene, train = made["scene/hockey"], made["train/hockey/kalman"]
    damaged = [store.folder("scene", scene.id), store.folder("rollouts", made["rollouts/hockey"].id)]
    (damaged[0] / "version.json").write_text('{"id":')
    text = (damaged[1] / "version.json").read_text()
    (damaged[1] / "version.json").write_text(text.replace('"seed":', '"seee":', 1))
    code, out, errors = slapshot("versions", *(part.replace("TRAIN", train.id) for part in command))
    assert code == 0
    lines = [f"slapshot: {folder}/version.json is not what was written there; run " for folder in damaged]
    assert [line[: len(lines[0])] for line in sorted(errors.splitlines())] == [
        line[: len(lines[0])] for line in sorted(lines)
    ]
    assert out


def test_nothing_damaged_is_locked(slapshot):
    made = fill()
    train = made["train/hockey/kalman"]
    (Store(Path("data/store")).folder("train", train.id) / "payload.csv").write_text("x\n1\n3\n")
    code, _, errors = slapshot("versions", "lock")
    assert code == 1
    assert one_line(errors).startswith(
        "slapshot: train/hockey/kalman: damaged: payload.csv not as written; run `slapshot versions verify"
    )
    assert not Path("data/pipeline.lock").exists()


def test_verify_without_or_with_a_damaged_lock(slapshot):
    code, _, errors = slapshot("versions", "verify")
    assert code == 1
    assert "data/pipeline.lock is missing: restore it from git" in one_line(errors)
    Path("data").mkdir()
    Path("data/pipeline.lock").write_text('{"scene/hockey"')
    code, _, errors = slapshot("versions", "verify")
    assert code == 1
    assert "data/pipeline.lock is damaged (" in one_line(errors)


def test_nothing_is_locked_before_everything_is_made(slapshot):
    code, _, errors = slapshot("versions", "lock")
    assert code == 1
    assert "is not made yet: run `snakemake figures` first" in one_line(errors)
    assert not Path("data/pipeline.lock").exists()


def test_a_bad_configuration_is_named_in_one_line(slapshot):
    change_default("noise_variance_max: 0.5", "noise_variance_max: -1")
    code, out, errors = slapshot("versions", "why", "train")
    assert (code, out) == (1, "")
    lines = Path("config/default.yaml").read_text().splitlines()
    number = 1 + next(i for i, line in enumerate(lines) if line == "      noise_variance_max: -1")
    key = f"slapshot: config/default.yaml:{number}: domains.hockey.training.noise_variance_max"
    assert one_line(errors).startswith(f"{key}: -1 is out of range; it must be >= 0 (")


def test_outside_the_repository(slapshot, monkeypatch):
    Path("empty").mkdir()
    monkeypatch.chdir("empty")
    code, _, errors = slapshot("versions", "gc")
    assert code == 1
    assert "run this in the top folder of the repository" in one_line(errors)


def test_check_describes_a_recording(slapshot):
    write_recording(make_recording(), Path("recording"))
    code, out, errors = slapshot("check", "recording")
    assert (code, errors) == (0, "")
    assert out.startswith("rig ")


def test_check_of_a_bad_recording_names_the_file_in_one_line(slapshot):
    write_recording(make_recording(), Path("recording"))
    Path("recording/hits.parquet").unlink()
    code, out, errors = slapshot("check", "recording")
    assert (code, out) == (1, "")
    assert "hits.parquet" in errors
    assert errors.count("\n") == 1


@pytest.mark.parametrize(
    "arguments", [(), ("versions",), ("versions", "lst"), ("versions", "diff", "a"), ("chek",)]
)
def test_an_unknown_command_shows_the_usage(slapshot, arguments):
    code, _, errors = slapshot(*arguments)
    assert code == 2
    assert errors.startswith("usage: slapshot")
