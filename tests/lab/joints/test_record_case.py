"""A case as a whole: by its seed, sealed, and saying nothing of what it conceals."""

import hashlib
import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from slapshot.errors import InputError
from slapshot.lab.joints.__main__ import main, write_case
from slapshot.lab.joints.case_spec import CaseSpec, JointCaseSettings, MeasurementCondition
from slapshot.lab.joints.cases import Case, read_cases, write_cases
from slapshot.lab.joints.lists import LISTS, draw_list
from slapshot.lab.joints.record_case import check_hidden_effects, make, make_case
from slapshot.lab.joints.registry import HIDDEN_EFFECTS
from slapshot.lab.joints.rigs import rig_named
from slapshot.recordings.signals import read_signals
from slapshot.validation import values_of

SHORT = {"episodes": 5, "seconds": 0.5}
SEED = 918273645
CONCEALS = (("spring", 4.0), ("encoder_scale", 6.0))


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    root = tmp_path_factory.mktemp("cases")
    for name, conceals in (("pair", CONCEALS), ("null", ())):
        write_case(CaseSpec("arm", SEED, conceals, **SHORT), root / name)
    return root


def test_a_case_is_written_whole_and_its_truth_is_sealed(folders):
    folder = folders / "pair"
    assert {p.name for p in folder.iterdir()} == {"recording", "model.xml", "rig.yaml", "sealed"}
    assert (folder / "rig.yaml").read_text() == "model: model.xml\n"
    recording = read_signals(folder / "recording")
    sealed = (folder / "sealed" / "truth.json").read_bytes()
    assert recording.sealed_truth_sha256 == hashlib.sha256(sealed).hexdigest()
    truth = json.loads(sealed)
    assert truth["kinds"] == ["spring", "encoder_scale"]
    assert truth["seed"] == SEED
    for one, (_, requested) in zip(truth["concealed"], CONCEALS, strict=True):
        assert one["size"] == pytest.approx(requested, rel=0.2)


def test_a_recording_says_neither_what_is_concealed_nor_the_seed(folders):
    words = [name.encode() for name in HIDDEN_EFFECTS] + [str(SEED).encode(), b"amplitude", b"cluttered"]
    names = {}
    for case in ("pair", "null"):
        told = sorted((folders / case / "recording").iterdir())
        names[case] = [file.name for file in told]
        for file in told:
            content = file.read_bytes()
            assert not [word for word in words if word in content], file.name
    assert names["pair"] == names["null"]
    headers = [json.loads((folders / c / "recording" / "recording.json").read_text()) for c in names]
    assert {key for key in headers[0] if headers[0][key] != headers[1][key]} == {"sealed_truth_sha256"}
    for file in ("model.xml", "rig.yaml"):
        assert (folders / "pair" / file).read_bytes() == (folders / "null" / file).read_bytes()


def test_the_truth_knows_what_encoders_told_without_noise(folders):
    recording = read_signals(folders / "pair" / "recording")
    truth = json.loads((folders / "pair" / "sealed" / "truth.json").read_text())
    (table,) = recording.signals.values()
    noiseless = truth["noiseless"]
    assert noiseless["episodes"] == [1, 2, 3, 4]
    rows = table[table["episode"].isin(noiseless["episodes"])]
    for channel, values in noiseless["channels"].items():
        noise = rows[channel].to_numpy() - np.ravel(values)
        assert noise.std() == pytest.approx(1e-3, rel=4 / np.sqrt(2 * len(noise)))
        assert abs(noise.mean()) < 4e-3 / np.sqrt(len(noise))


def test_cases_are_those_of_their_seed():
    one, again = (make_case("arm", ("encoder_delay",), 5, size=2.0, **SHORT) for _ in range(2))
    other = make_case("arm", ("encoder_delay",), 6, size=2.0, **SHORT)
    assert json.dumps(one[1]) == json.dumps(again[1])
    tables = [next(iter(recording.signals.values())) for recording, _ in (one, again, other)]
    assert tables[0].equals(tables[1])
    assert not np.isclose(tables[0]["joint1_position"], tables[2]["joint1_position"]).any()


def test_a_size_that_is_left_open_is_drawn():
    sizes = [make_case("arm", ("encoder_scale",), seed, **SHORT)[1]["concealed"][0] for seed in range(3)]
    assert all(0.3 <= one["size_asked"] <= 30 for one in sizes)
    assert len({one["size_asked"] for one in sizes}) == 3


def test_clutter_and_coarse_encoders_are_told_in_the_truth_alone():
    recording, truth = make_case("arm", (), 3, noise="ou20", cluttered=True, quantised=1e-3, **SHORT)
    assert truth["law_error"]["rms"] == 0.1
    assert truth["law_error"]["size"] > 0.5
    assert truth["chance"]["correlation_s"] == 0.02
    assert truth["size"] == 0.0
    (table,) = recording.signals.values()
    steps = table["joint2_position"] / 1e-3
    assert np.abs(steps - steps.round()).max() < 1e-6
    assert np.diff(table["t"][:100]) == pytest.approx(np.full(99, 0.005))


def test_what_is_not_possible_is_refused(tmp_path):
    for kinds, words in (
        (("ghost",), "no hidden effect 'ghost'"),
        (("spring", "spring"), "is given twice"),
        (("joint_elasticity", "backlash"), "split the same joint"),
    ):
        with pytest.raises(InputError, match=words):
            make_case("arm", kinds, 1)
    with pytest.raises(InputError, match="is not observable on rig kuka"):
        make_case("kuka", ("gravity_tilt",), 1)
    with pytest.raises(InputError, match="no rig 'crane'"):
        make_case("crane", (), 1)
    with pytest.raises(InputError, match="no noise 'pink'"):
        make_case("arm", (), 1, noise="pink")
    with pytest.raises(InputError, match="exists already"):
        write_case(CaseSpec("arm", 1), tmp_path)


def test_lists_are_read_as_they_were_written(tmp_path):
    cases = [
        Case("j0000", "null, cluttered", CaseSpec("arm", 4, (), MeasurementCondition("ou100", True, 1e-3))),
        Case(
            "j0001", "pair", CaseSpec("kuka", 5, (("spring", 3.5), ("payload", 0.4)), episodes=6, seconds=1.5)
        ),
    ]
    file = tmp_path / "list.csv"
    write_cases(cases, file)
    assert read_cases(file) == cases


def test_drawn_lists_have_what_fits_in_random_order_under_new_seeds():
    cases = draw_list(LISTS["full"], "j")
    assert [case.case for case in cases] == [f"j{i:04d}" for i in range(len(cases))]
    assert len({case.spec.seed for case in cases}) == len(cases)
    assert {case.spec.seed for case in cases}.isdisjoint(c.spec.seed for c in draw_list(LISTS["full"], "j"))
    for case in cases:
        kinds = [effect for effect, _ in case.spec.conceals]
        check_hidden_effects(kinds, rig_named(case.spec.rig))
        assert len(kinds) == {"pair": 2, "null": 0}.get(case.condition.split(",")[0], 1)
        assert all(0.29 < size < 30.1 for _, size in case.spec.conceals)
    shown = {effect for case in cases for effect, _ in case.spec.conceals}
    assert shown == set(HIDDEN_EFFECTS)


def test_the_lists_that_ship_can_be_read_and_are_large_enough():
    folder = Path(__file__).parents[3] / "config" / "cases"
    found = Counter(case.condition for case in read_cases(folder / "joints.csv"))
    assert found["null"] + found["null, cluttered"] >= 150
    assert found["null, cluttered"] >= 50
    assert found["single"] >= 100
    assert found["pair"] >= 40
    assert found["uncatalogued"] >= 40
    assert 20 <= len(read_cases(folder / "joints-small.csv")) <= 30


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("a,null,arm,1,,pink,no,,20,3", "pink"),
        ("a,null,crane,1,,white,no,,20,3", "no rig 'crane'"),
        ("a,single,kuka,1,gravity_tilt:3,white,no,,20,3", "is not observable on rig kuka"),
        ("a,single,arm,1,spring:lots,white,no,,20,3", "size"),
        ("a,null,arm,1,,white,maybe,,20,3", "cluttered"),
        ("a,null,arm,1,,white,no", "has 7 values"),
    ],
)
def test_rows_that_cannot_be_say_so_in_one_line(tmp_path, line, words):
    file = tmp_path / "list.csv"
    write_cases([], file)
    file.write_text(file.read_text() + line + "\n")
    with pytest.raises(InputError, match=words) as caught:
        read_cases(file)
    assert str(caught.value).startswith(f"{file}:2")
    assert "\n" not in str(caught.value)


def test_a_plan_reads_rows_without_building_rigs(tmp_path):
    """What a rig cannot conceal is then told by who makes the case; what is no row is told at once."""
    file = tmp_path / "list.csv"
    write_cases([Case("a", "single", CaseSpec("kuka", 1, (("gravity_tilt", 3.0),)))], file)
    (case,) = read_cases(file, possible=False)
    with pytest.raises(InputError, match="is not observable on rig kuka"):
        make(case.spec)
    file.write_text(file.read_text().replace("white", "pink"))
    with pytest.raises(InputError, match="pink"):
        read_cases(file, possible=False)


@pytest.mark.parametrize(
    "spec",
    [
        CaseSpec(
            "kuka",
            2**47,
            (("spring", 3.5), ("payload", 0.4)),
            MeasurementCondition("ou20", True, 1e-3),
            6,
            1.5,
        ),
        CaseSpec("arm", 4),
    ],
)
def test_a_specification_survives_a_recipe(spec):
    written = json.dumps(values_of(JointCaseSettings(spec=spec)))
    assert JointCaseSettings.model_validate_json(written).spec == spec


def test_the_command_names_what_is_missing(tmp_path, monkeypatch, capsys):
    out, file = tmp_path / "out", tmp_path / "list.csv"
    write_cases([Case("j0000", "null", CaseSpec("arm", 4))], file)
    for given, words in (
        (["--rig", "arm"], "--seed is missing"),
        (["--case", "j0001", "--list", str(file)], f"--case j0001: is not in {file}"),
        (["--rig", "arm", "--seed", "1", "--kinds", "ghost"], "lab: no hidden effect 'ghost'"),
    ):
        monkeypatch.setattr("sys.argv", ["joints", *given, "--out", str(out)])
        with pytest.raises(SystemExit, match="1"):
            main()
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert line.startswith(words)
        assert not out.exists()
