"""Stage `claims`: all verdicts in one table, as Markdown, HTML and CSV."""

import html
import math

import pandas as pd

from slapshot.command import Run, stage_command
from slapshot.parquet import read_frame

INTRODUCTION = (
    "Computed by `snakemake figures` from the versions in the store; nothing here is typed. Intervals "
    "are 95 %, from a bootstrap over models and over test conditions or rigs. A statement holds, or "
    "does not, if its whole interval says so; otherwise it is undecided. Recordings are of stand-in "
    "rigs (simulated apart from the training data, with concealed physics), not of a real robot; the "
    "paper's own are not public. The paper's centimetres stand beside ours where it gives them: they "
    "depend on how hard pucks are hit."
)
_STYLE = (
    "body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:75em;padding:0 1em;color:#222}"
    "table{border-collapse:collapse}td,th{border-bottom:1px solid #ddd;padding:.4em .7em;text-align:left;"
    "vertical-align:top}.holds{color:#00704f}.does{color:#b03000}.undecided{color:#777}small{color:#555}"
)


def produce(run: Run) -> None:
    """Write claims.md, claims.html and claims.csv."""
    tables = []
    for role, folder in run.inputs.items():
        claim = role.split("/")[1]
        tables.append(read_frame(folder / "statements.parquet").assign(claim=claim))
    made = [table for table in tables if len(table)] or tables[:1]
    table = pd.concat(made, ignore_index=True).sort_values("claim", kind="stable")
    first = [
        "claim",
        "domain",
        "text",
        "verdict",
        "measure",
        "value",
        "low",
        "high",
        "above",
        "below",
        "unit",
    ]
    numbers = ["value", "low", "high", "above", "below"]
    scaled = table.assign(**{name: table["scale"] * table[name] for name in numbers})
    scaled[[*first, "paper", "note"]].to_csv(run.out / "claims.csv", index=False, float_format="%.6g")
    (run.out / "claims.md").write_text(_markdown(table))
    (run.out / "claims.html").write_text(_html(table))


def _markdown(table: pd.DataFrame) -> str:
    parts = ["# Claims of the paper, on our own numbers", "", INTRODUCTION, ""]
    for (claim, domain, title), rows in table.groupby(["claim", "domain", "title"], sort=False):
        parts += [f"## {claim} ({domain}): {title}", "", "| statement | verdict | measured | paper |",
                  "|---|---|---|---|"]  # fmt: skip
        for _, row in rows.iterrows():
            note = f"<br>*{row['note']}*" if row["note"] else ""
            cells = (f"{row['text']}{note}", f"**{row['verdict']}**", _measured(row), row["paper"])
            # A bar ends a cell, and |correlation| has two.
            escaped = [cell.replace("|", r"\|") for cell in cells]
            parts.append(f"| {' | '.join(escaped)} |")
        parts.append("")
    return "\n".join(parts)


def _html(table: pd.DataFrame) -> str:
    parts = []
    for (claim, domain, title), rows in table.groupby(["claim", "domain", "title"], sort=False):
        parts.append(f"<h2>{claim} ({html.escape(str(domain))}): {html.escape(str(title))}</h2><table>")
        parts.append("<tr><th>statement<th>verdict<th>measured<th>paper</tr>")
        for _, row in rows.iterrows():
            note = f"<br><small>{html.escape(row['note'])}</small>" if row["note"] else ""
            kind = row["verdict"].split()[0]
            parts.append(
                f"<tr><td>{html.escape(row['text'])}{note}<td class={kind}><b>{row['verdict']}</b>"
                f"<td>{html.escape(_measured(row))}<td>{html.escape(row['paper'])}</tr>"
            )
        parts.append("</table>")
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Claims</title><style>{_STYLE}</style>'
        f"<h1>Claims of the paper, on our own numbers</h1><p>{html.escape(INTRODUCTION)}</p>"
        f"{''.join(parts)}</html>\n"
    )


def _measured(row: pd.Series) -> str:
    value, low, high = (f"{row['scale'] * row[name]:.3g}" for name in ("value", "low", "high"))
    unit = f" {row['unit']}" if row["unit"] else ""
    wanted = [f"above {row['scale'] * row['above']:.3g}"] if math.isfinite(row["above"]) else []
    wanted += [f"below {row['scale'] * row['below']:.3g}"] if math.isfinite(row["below"]) else []
    return f"{row['measure']}: {value}{unit} ({low} to {high}); holds {' and '.join(wanted)}"


if __name__ == "__main__":
    stage_command("claims", produce)
