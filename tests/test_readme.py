"""Numbers that README and docs state are those of published tables.

Those of the proof are checked in tests/blind_validation/test_draw.py.
"""

import re
from pathlib import Path

import pandas as pd
import pytest

ROOT = Path(__file__).parents[1]
FIGURES = ROOT / "figures"


@pytest.fixture(scope="module")
def text() -> str:
    """README and docs in one line."""
    files = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    return " ".join(" ".join(file.read_text() for file in files).split())


@pytest.mark.parametrize(
    "file",
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))],
    ids=lambda file: file.name,
)
def test_links_lead_to_what_is_there(file):
    links = re.findall(r"\]\(([^)#]+)", file.read_text())
    assert [link for link in links if "://" not in link and not (file.parent / link).exists()] == []


def table(name: str) -> pd.DataFrame:
    return pd.read_csv(FIGURES / f"{name}.csv")


def curve(rows: pd.DataFrame, **kept: object) -> pd.Series:
    """Error in cm by samples seen."""
    for column, value in kept.items():
        rows = rows[rows[column] == value]
    return 100 * rows.set_index("samples")["error_m"]


def lead(rows: pd.DataFrame, most: int) -> float:
    """The LSTM's error over Kalman's, mean over samples from 1 on."""
    few = rows[rows["samples"].between(1, most)]
    mean = few.groupby("method")["error_m"].mean()
    return mean["lstm"] / mean["kalman"]


def test_errors_on_rigs_and_in_simulation(text):
    recorded = curve(table("F8-hockey-recorded"), panel="a, b", method="kalman")
    simulated = curve(table("F7-hockey-simulated"), panel="a", method="kalman")
    assert (
        f"Before the first hit the Kalman model errs by {recorded[0]:.0f} cm, after 4 hits by "
        f"{recorded[4]:.1f} cm, after 16 by {recorded[16]:.1f} cm" in text
    )
    assert f"where nothing is concealed, {simulated[0]:.0f} cm become {simulated[16]:.0f} after 16." in text


def test_the_circle_is_told_with_what_speaks_against_it(text):
    rows = table("circle-hockey/F8-hockey-arms")
    held_out = rows[rows["hits"] == "hits held out from the diagnosis"]
    nominal, refitted, augmented = (curve(held_out, arm=arm) for arm in ("nominal", "refitted", "augmented"))
    refined = curve(table("A5-hockey-refined"), arm="refined ranges")
    floor = 100 * held_out["noise_floor_m"].iloc[0]
    assert (
        f"errs by {augmented[0]:.0f} cm on held-out hits before it has seen a single one, instead of "
        f"{nominal[0]:.0f} (nominal) or {refitted[0]:.0f} (ranges refitted), but after 4 hits by "
        f"{augmented[4]:.1f} against nominal {nominal[4]:.1f} (and {refitted[4]:.1f} with ranges refitted), "
        f"with a noise floor of {floor:.1f}, and models of ranges refined without any named physics (figure "
        f"A5) err by {refined[0]:.1f} cm" in text
    )


def test_the_lead_over_the_lstm_by_noise_and_on_rigs(text):
    hockey, fetchslide = table("F7-hockey-simulated"), table("F4-fetchslide-errors")
    by_noise = [
        [lead(rows, most) for _, rows in own.groupby("noise_variance")]
        for own, most in ((hockey[hockey["panel"] == "c"], 8), (fetchslide[fetchslide["panel"] == "b"], 10))
    ]
    first, second = ("{:.3f}, {:.3f} and {:.3f}".format(*ratios) for ratios in by_noise)
    assert f"is {first} at noise variance 0, 0.1 and 0.5 in hockey (mean over samples 1 to 8" in text
    assert f"and {second} in FetchSlide (samples 1 to 10" in text
    # What the sentence before them says.
    assert all(ratios == sorted(ratios, reverse=True) for ratios in by_noise)
    recorded = table("F8-hockey-recorded")
    rigs = lead(recorded[recorded["panel"] == "a, b"], 8)
    simulated = lead(hockey[hockey["panel"] == "a"], 8)
    assert f"recorded rigs ({rigs:.3f}," in text
    assert f"in simulation ({simulated:.3f})" in text


def test_what_was_tuned(text):
    tuning = table("tuning")
    assert set(tuning["domain"]) == {"hockey"}
    assert "FetchSlide was not tuned" in text
    best = tuning.loc[tuning.groupby("method")["validation_loss"].idxmin()]
    assert len(best) == 5
    assert set(best["learning_rate"]) == {tuning["learning_rate"].max()}
    assert f"For all five methods that is {tuning['learning_rate'].max():g}, the largest of the four" in text


def test_truths_about_mass(text):
    mass = table("A3-hockey-refinement").query("parameter == 'mass'")
    drawable = mass[mass["drawable"]]
    assert f"Of {len(mass)} truths about mass training can draw {len(drawable)}" in text
    assert f"the ranges hold {drawable['inside'].sum()} of them" in text


def test_hours_at_the_paper_s_scale(text):
    value = table("benchmark").set_index("measure")["value"]
    hours = value["hockey_paper_long_stages_hours_on_2_cores"]
    assert f"long stages would take {hours:.0f} hours of two cores" in text
    assert f"(`paper_*`: {value['paper_core_hours']:.0f} core hours)" in text


def test_how_long_the_figures_took(text):
    minutes = table("benchmark").set_index("measure")["value"]["figures_wall_minutes"]
    assert f"`make figures` took {minutes:.0f} minutes from an empty store" in text
    assert f"That run took {minutes:.0f} minutes on two cores" in text
