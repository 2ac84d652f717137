"""Page, figures and the table of docs/proof.md, from tables; what is published is what its tables say."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.testing.compare import compare_images
from slapshot.blind_validation import docs_table
from slapshot.blind_validation.case_table import (
    COLUMNS,
    FIRST,
    JOINTS,
    MEASURES,
    NEWER_COLUMNS,
    merge_measures,
    read_cases_table,
    read_measures,
    write_cases_table,
    write_measures,
)
from slapshot.blind_validation.figures import draw_all
from slapshot.blind_validation.measures import measures_of
from slapshot.blind_validation.page import percent, write_page
from slapshot.blind_validation.redraw import redraw
from slapshot.config.cases import ProofSettings
from slapshot.config.files import load_config
from slapshot.config.trajectories import Pool
from slapshot.errors import InputError

from .conftest import concealed, effect, verdict

ROOT = Path(__file__).parents[2]
DRAWN = [
    f"{name}.{k}"
    for name in ("P1-confusion", "P2-by-size", "P3-fit", "P4-calibration")
    for k in ("csv", "pdf", "png")
]
PROOFS = {"full": ("proof", "."), "small": ("small-proof", "small-proof")}


@pytest.fixture
def cases(scored, tmp_path):
    """Reads scored cases back from cases.csv, as the stage does."""

    def run(*rows):
        write_cases_table(list(rows), tmp_path / "cases.csv")
        return read_cases_table(tmp_path / "cases.csv")

    return run


def test_the_page_tells_aims_and_confusions(scored, cases, tmp_path, monkeypatch):
    wrong = scored("plain", [concealed("tilt")], verdict(effect("curl")))
    flagged = scored("plain", [concealed("curl")], verdict(effect("tilt"), unknown=True), "c2")
    table = cases(wrong, flagged, scored("null", [], verdict(), "c3"))
    monkeypatch.chdir(ROOT)
    config = load_config()
    pool = Pool.from_parts(config.cases.pool, count=9, heading_rad=1.5, speed_m_s=[1, 2])
    told = ProofSettings(list="small", pool=pool, lab=config.lab_of_cases)
    write_page(tmp_path / "proof.md", table, pd.DataFrame(measures_of(table)), told)
    text = (tmp_path / "proof.md").read_text()
    assert "A small proof: 3 cases" in text
    assert "| naming_top1 | plain | at least 95 % | 0 % (0 to 66) | 2 | **no** |" in text
    assert "| c1 | plain | tilt | 0.80 | curl | curl |  |" in text
    assert "| c2 | plain | curl | 0.80 | tilt | tilt | yes |" in text
    assert "| false_alarm | null | 200 | 0 % (0 to 79) | 1 |" in text
    assert "stand-in" in text
    for listed, partial in ((None, False), (3, False), (566, True)):
        write_page(tmp_path / "proof.md", table, pd.DataFrame(measures_of(table)), told, listed)
        assert ("**3 of 566 cases,**" in (tmp_path / "proof.md").read_text()) == partial


def test_cases_read_as_they_were_written(scored, cases):
    reported = replace(
        verdict(), cannot_tell="too few hits", mismatch=None, location=None, unknown=None, fit=None
    )
    table = cases(scored("null", [], verdict()), scored("plain", [concealed("tilt")], reported, "c2"))
    assert tuple(table) == (*COLUMNS, *NEWER_COLUMNS)
    first, second = table.to_dict("records")
    # A condition is called null, and no name is "".
    assert (first["condition"], first["conceals"], first["named"]) == ("null", "", "")
    assert first["found"] is False
    assert np.isnan(first["top1"])
    assert (second["cannot_tell"], second["conceals"], second["found"]) == ("too few hits", "tilt", False)
    assert np.isnan(second["augmented_track_rmse_m"])


def test_a_table_that_lacks_a_column_is_told_in_one_line(scored, cases, tmp_path):
    cases(scored("null", [], verdict()))
    file = tmp_path / "cases.csv"
    pd.read_csv(file).drop(columns=["unknown", "hits"]).to_csv(file, index=False)
    with pytest.raises(InputError, match="lacks the columns hits, unknown") as error:
        read_cases_table(file)
    assert str(file) in str(error.value)
    assert "\n" not in str(error.value)


OTHERS = """lab,measure,condition,value,low,high,n
first,false_alarm,null,0.005,0.001,0.03,200
joints,false_alarm,null,0.01,0.005,0.0498713,110
joints,cpu_s,"all, nothing concealed",21.5,20,23.25,170
"""


def test_measures_of_one_lab_leave_those_of_others_as_they_are(tmp_path):
    file = tmp_path / "proof.csv"
    file.write_text(OTHERS)
    table = pd.DataFrame([("in_class", "plain", 0.975, 0.9, 1.0, 53)], columns=list(MEASURES[1:]))
    write_measures(table, FIRST, file)
    head, _, *joints = OTHERS.splitlines()
    own = "first,in_class,plain,0.975,0.9,1,53"
    assert file.read_text().splitlines() == [head, own, *joints]
    pd.testing.assert_frame_equal(read_measures(file, FIRST), table)
    assert read_measures(file, JOINTS)["condition"].tolist() == ["null", "all, nothing concealed"]
    write_measures(table, JOINTS, file)
    assert file.read_text().splitlines() == [head, own, own.replace("first", "joints")]


def test_measures_are_merged_into_what_is_published(tmp_path):
    fresh, published = tmp_path / "fresh.csv", tmp_path / "proof.csv"
    head, first, *joints = OTHERS.splitlines(keepends=True)
    fresh.write_text(head + joints[0].replace("0.0498713", "0.05"))
    merge_measures(fresh, published)
    assert published.read_text() == fresh.read_text()
    published.write_text(OTHERS)
    merge_measures(fresh, published)
    assert published.read_text() == head + first + joints[0].replace("0.0498713", "0.05")
    published.write_text("measure,condition,value,low,high,n\n")
    with pytest.raises(InputError, match="lacks lab; run `snakemake proof` for a whole one"):
        merge_measures(fresh, published)


@pytest.mark.parametrize(
    ("share", "reported"),
    [
        (0, "0"), (1e-17, "0"), (0.005, "0.5"), (0.00088, "0.1"), (0.01, "1"), (0.0278, "3"), (0.15, "15"),
        (0.9434, "94"), (0.99, "99"), (0.995, "99.5"), (1, "100"),
    ],
)  # fmt: skip
def test_percents_are_whole_but_where_that_would_say_nothing_or_all(share, reported):
    assert percent(share) == reported


def test_what_is_called_unknown_stands_beside_what_is_named(scored, cases):
    tether = [concealed("tether", catalogued=False)]
    table = cases(
        scored("uncatalogued", tether, verdict(effect("tilt"), unknown=True)),
        scored("uncatalogued", tether, verdict(effect("tilt"), unknown=True)),
        scored("uncatalogued", tether, verdict(effect("tilt"))),
        scored("uncatalogued", tether, verdict(unknown=True)),
        scored("plain", [concealed("curl")], verdict(effect("curl"))),
        scored("null", [], verdict()),
    )
    drawing = next(draw_all(table))
    reported = drawing.table.set_index(["panel", "concealed", "answer"])[["cases", "of"]].apply(tuple, axis=1)
    assert reported.to_dict() == {
        ("named first", "tether", "tilt"): (3, 4),
        ("named first", "tether", "no name"): (1, 4),
        ("named first", "curl", "curl"): (1, 1),
        ("named first", "nothing", "no name"): (1, 1),
        ("called", "tether", "mismatch"): (4, 4),
        ("called", "tether", "unknown"): (3, 4),
        ("called", "curl", "mismatch"): (1, 1),
    }
    drawing.figure.canvas.draw()
    named, called = drawing.figure.axes
    assert [text.get_text() for text in called.texts] == ["1", "4", "3"]
    assert [label.get_text() for label in called.get_xticklabels()] == ["mismatch", "unknown"]
    rows = [label.get_text() for label in named.get_yticklabels()]
    assert rows == ["curl (1)", "tether (4)", "nothing (1)"]


def test_a_list_of_nulls_alone_is_drawn(scored, cases):
    drawings = list(draw_all(cases(scored("null", [], verdict()))))
    assert drawings[0].table["of"].tolist() == [1]
    assert drawings[1].figure.axes[0].get_title(loc="left").startswith("0 cases, one catalogued effect")


@pytest.mark.parametrize("which", PROOFS)
def test_a_published_proof_is_drawn_anew_from_its_cases_alone(which, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    folder, pages = (ROOT / "figures" / part for part in PROOFS[which])
    shutil.copyfile(folder / "cases.csv", tmp_path / "cases.csv")
    redraw(tmp_path, tmp_path, which)
    names = {file.name for file in tmp_path.iterdir()}
    assert names == {"cases.csv", "proof.csv", "proof.md", *DRAWN}
    for name in sorted(names):
        published = (pages if name.startswith("proof") else folder) / name
        if name.endswith(".png"):  # other versions of the library of fonts shift single pixels
            assert compare_images(str(published), str(tmp_path / name), tol=10) is None
        elif name == "proof.csv":  # the published one has rows of other labs, too
            pd.testing.assert_frame_equal(
                read_measures(tmp_path / name, FIRST), read_measures(published, FIRST), check_exact=True
            )
        elif not name.endswith(".pdf"):
            assert (tmp_path / name).read_text() == published.read_text(), name


def test_the_table_of_the_docs_is_that_of_the_published_proof():
    """After `snakemake proof`: python -m slapshot.blind_validation.docs_table."""
    text = (ROOT / "docs/proof.md").read_text()
    assert text == docs_table.with_table(
        text, docs_table.table(read_measures(ROOT / "figures/proof.csv", FIRST))
    )


def test_another_number_is_another_table():
    measures = read_measures(ROOT / "figures/proof.csv", FIRST)
    alarms = (measures["measure"] == "false_alarm") & (measures["condition"] == "null")
    unknown = (measures["measure"] == "false_unknown") & (measures["condition"] == "plain")
    numbers = ["value", "low", "high", "n"]
    measures.loc[alarms, numbers] = [0.005, 0.001, 0.03, 200]
    measures.loc[unknown, numbers] = [8 / 53, 0.08, 0.27, 53]
    made = docs_table.table(measures.astype({"n": int}))
    assert "| 1 of 200 | 0.5 % (0.1 to 3) | at most 2 %: met |" in made
    assert "| 8 of 53 | 15 % (8 to 27) | at most 5 %: **missed** |" in made
    measures.loc[alarms, "value"] = 0.03
    assert "| 6 of 200 | 3 % (0.1 to 3) | at most 2 %: **missed** |" in docs_table.table(
        measures.astype({"n": int})
    )
    with pytest.raises(InputError, match="no row false_alarm, null"):
        docs_table.table(measures[~alarms])
    made = docs_table.table(measures[measures["condition"] != "weak"])
    assert "named first | none yet |  | at least 80 % |" in made


@pytest.mark.parametrize(
    "text",
    [
        "nothing",
        docs_table.BEGIN,
        f"{docs_table.END} {docs_table.BEGIN}",
        f"{docs_table.BEGIN}{docs_table.END}" * 2,
    ],
)
def test_a_page_without_its_marks_is_told(text):
    with pytest.raises(InputError, match="once each and in this order"):
        docs_table.with_table(text, "table")


def test_between_the_marks_all_is_replaced():
    text = f"before {docs_table.BEGIN} old {docs_table.END} after"
    assert docs_table.with_table(text, "new") == f"before {docs_table.BEGIN}\n\nnew\n\n{docs_table.END} after"
