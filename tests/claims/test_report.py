"""Stages `claim` and `claims`: statements to a table, tables to what people read."""

import html.parser
import math
import re
from types import SimpleNamespace

import pandas as pd
import pytest
from slapshot.claims import __main__ as claim
from slapshot.claims import report
from slapshot.claims.statement import Statement
from slapshot.command import Run
from slapshot.statistics import Interval

STATEMENTS = {
    "C4": [
        Statement("A & B are <alike>", "A's error over B's", Interval(1.0, 0.95, 1.05), above=0.9, below=1.1,
                  paper='"no change"', note="a margin <of our own>"),
        Statement("A stays above 20 cm", "its error", Interval(0.1234, 0.1, 0.15), above=0.2, unit="cm",
                  scale=100, paper="over 20 cm"),
    ],
    "C7": [Statement("X follows Y", "|correlation| less |other|", Interval(0.1, -0.2, 0.3), above=0)],
    "C5": [],
}  # fmt: skip


@pytest.fixture
def published(tmp_path, monkeypatch):
    """Folder with what the two stages write."""
    inputs = {}
    for name, statements in STATEMENTS.items():
        out = tmp_path / name
        out.mkdir()
        module = SimpleNamespace(TITLE=f"title of {name} <i>", evaluate=lambda inputs, own=statements: own)
        monkeypatch.setattr(claim, "import_module", lambda _, module=module: module)
        claim.produce(Run({"module": "any", "domain": "hockey"}, {}, out, 1))
        inputs[f"hockey/{name}"] = out
    out = tmp_path / "claims"
    out.mkdir()
    report.produce(Run({}, dict(reversed(inputs.items())), out, 1))
    return out


def test_the_table_has_numbers_in_their_unit_in_the_order_of_claims(published):
    table = pd.read_csv(published / "claims.csv", keep_default_na=False, na_values=["nan"])
    assert table["claim"].tolist() == ["C4", "C4", "C7"]
    assert table["verdict"].tolist() == ["holds", "does not hold", "undecided"]
    second = table.iloc[1]
    assert second["unit"] == "cm"
    assert second[["value", "low", "high", "above"]].tolist() == pytest.approx([12.34, 10, 15, 20])
    assert math.isinf(second["below"])
    assert table["paper"].tolist() == ['"no change"', "over 20 cm", ""]


def test_markdown_is_a_table_a_claim_with_four_cells_a_row(published):
    text = (published / "claims.md").read_text()
    assert "## C4 (hockey): title of C4 <i>" in text
    assert "C5" not in text
    rows = [line for line in text.splitlines() if line.startswith("| ") and "statement" not in line]
    assert len(rows) == 3
    for row in rows:
        assert len(re.split(r"(?<!\\)\|", row)) == 4 + 2, row
    assert r"\|correlation\| less \|other\|: 0.1 (-0.2 to 0.3); holds above 0" in text
    assert "| **does not hold** | its error: 12.3 cm (10 to 15); holds above 20 | over 20 cm |" in text
    assert "holds above 0.9 and below 1.1" in text
    assert "<br>*a margin <of our own>*" in text


class Reader(html.parser.HTMLParser):
    """Tags by name, and all text."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.text = ""

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data


def test_html_escapes_what_it_shows(published):
    reader = Reader()
    reader.feed((published / "claims.html").read_text())
    names = [tag for tag, _ in reader.tags]
    assert not {"i", "alike", "of"} & set(names)
    for text in (
        "A & B are <alike>",
        "title of C4 <i>",
        "a margin <of our own>",
        '"no change"',
        "12.3 cm (10 to 15)",
    ):
        assert text in reader.text
    assert names.count("table") == 2
    assert names.count("tr") == 2 + 3
    classes = [
        attributes["class"] for tag, attributes in reader.tags if tag == "td" and "class" in attributes
    ]
    assert classes == ["holds", "does", "undecided"]
    style = (published / "claims.html").read_text()
    assert all(f".{kind}{{color:" in style for kind in classes)


def test_a_claim_without_statements_alone_is_an_empty_report(tmp_path, monkeypatch):
    out = tmp_path / "C5"
    out.mkdir()
    monkeypatch.setattr(claim, "import_module", lambda _: SimpleNamespace(TITLE="t", evaluate=lambda _: []))
    claim.produce(Run({"module": "any", "domain": "hockey"}, {}, out, 1))
    report.produce(Run({}, {"hockey/C5": out}, tmp_path, 1))
    assert len(pd.read_csv(tmp_path / "claims.csv")) == 0
    assert "##" not in (tmp_path / "claims.md").read_text()
