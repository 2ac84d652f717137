"""What may not be said together in one report, told from its files alone.

verdict.json, verdict.md and the tables beside the figures are read as a person or another program would; no
class of the diagnosis is imported, so that the rules hold for whatever writes such a report.
"""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

HEADLINES = {
    "nothing_found": "Nothing found",
    "found": "Something is missing",
    "found_not_named": "Something is missing",
    "cannot_tell": "Cannot tell",
}
ERRORS = ("track_rmse_m", "rest_rmse_m", "command_rest_rmse_m")
SCENES = ("nominal", "refitted", "augmented", "noise_floor")


def contradictions(folder: Path) -> list[str]:
    """Everything in a report that contradicts something else in it, a line each."""
    verdict = json.loads((folder / "verdict.json").read_text())
    text = (folder / "verdict.md").read_text()
    tables = {file.stem: pd.read_csv(file) for file in sorted(folder.glob("D*.csv"))}
    found = list(_headline(verdict, text))
    if verdict["headline"] == "cannot_tell":
        found += _untold(verdict, text, tables, folder)
    else:
        found += _told(verdict, text)
        found += _figures(verdict, tables)
    found += _named_figures(text, folder)
    found += _augmented(verdict, folder)
    return found


def _headline(verdict: dict[str, Any], text: str) -> Iterator[str]:
    headline = verdict["headline"]
    if not text.startswith(f"# {HEADLINES[headline]}"):
        yield f"headline is {headline}, but the page begins {text[:60]!r}"
    if (verdict["cannot_tell"] is not None) != (headline == "cannot_tell"):
        yield f"headline is {headline}, but cannot_tell is {verdict['cannot_tell']!r}"
    if bool(verdict["effects"]) != (headline == "found"):
        yield f"headline is {headline}, but {len(verdict['effects'])} effects are named"
    if verdict["used"] > verdict["hits"]:
        yield "more hits are used than there are"
    for finding in verdict["findings"]:
        if _plain(finding)[:40].lower() not in _plain(text).lower():
            yield f"a finding of the check is not on the page: {finding[:40]!r}"
    if re.search(r"did not converge", text) and headline != "cannot_tell":
        yield f"a fit did not converge, and the headline is {headline}"


def _untold(
    verdict: dict[str, Any], text: str, tables: dict[str, pd.DataFrame], folder: Path
) -> Iterator[str]:
    for key in ("mismatch", "location", "unknown", "fit", "noise_sd_m", "friction_scatter"):
        if verdict[key] is not None:
            yield f"nothing can be told, but {key} is"
    if verdict["limits"] or verdict["next_hits"]:
        yield "nothing can be told, but limits or next hits are given"
    if re.search(r"noise floor|at most|\*\*(Yes|No)\.\*\*", text):
        yield "nothing can be told, but the page speaks of a floor, of limits or of a decision"
    if set(tables) - {"D1-hits"} or (folder / "diagnosis.rrd").exists():
        yield "nothing can be told, but figures show fits"
    if "D1-hits" in tables:
        states = tables["D1-hits"].groupby("state")["hit"].unique()
        if set(states.get("to blame", ())) != set(verdict["hits_to_blame"]):
            yield "D1-hits blames other hits than verdict.json"
    if _plain(verdict["cannot_tell"])[1:40] not in _plain(text):
        yield "why nothing can be told is not on the page"
    if not re.search(r"\b(record|hit|let|mend|vary|look)\b", verdict["cannot_tell"]):
        yield "nothing is said of what to record or mend"


def _told(verdict: dict[str, Any], text: str) -> Iterator[str]:
    headline, fit, mismatch = verdict["headline"], verdict["fit"], verdict["mismatch"]
    chi2 = fit["refitted"]["chi2_per_freedom"]
    if (mismatch["decided_by"] is not None) != mismatch["found"]:
        yield f"mismatch.found is {mismatch['found']}, decided by {mismatch['decided_by']}"
    if mismatch["found"] != (headline != "nothing_found"):
        yield f"headline is {headline}, but mismatch.found is {mismatch['found']}"
    if headline == "nothing_found":
        if chi2["low"] > 1:
            yield f"nothing is found, but held-out chi-squared is {chi2['value']:.2f} ({chi2['low']:.2f} up)"
        # Twenty to one for each of a thousand hypotheses: no page says so and that nothing is missing.
        if mismatch["log_evidence"] > 10 and mismatch["p_value"] > 0.002 and mismatch["shift_m"] > 0.003:
            yield f"nothing is found, with evidence of {mismatch['log_evidence']:.0f} nats"
        if verdict["unknown"]["flagged"] or verdict["location"]["phase"] is not None:
            yield "nothing is found, but something is placed"
        if "**Yes.**" in text or "**No.**" not in text:
            yield "nothing is found, but the page does not say no"
    else:
        if "**No.**" in text or "**Yes.**" not in text:
            yield "something is found, but the page does not say yes"
        if verdict["limits"] or re.search(r"could be there unseen", text):
            yield "something is found, but limits of what could be there are given"
        if "Nowhere" in text:
            yield "something is found, but nowhere"
    if headline == "found_not_named" and "Nothing to name" not in text and "Not in the catalogue" not in text:
        yield "nothing is named, but the page does not say so"
    for scene in SCENES:
        for measure in (*ERRORS, "loglik_per_hit", "chi2_per_freedom"):
            interval = fit[scene][measure]
            if interval is not None and not interval["low"] <= interval["value"] <= interval["high"]:
                yield f"{scene} {measure} lies outside its own interval"
    for measure in ERRORS:
        before, after, floor = (fit[s][measure] for s in ("refitted", "augmented", "noise_floor"))
        if before is None:
            continue
        if after["low"] > before["high"]:
            yield f"what is named makes {measure} worse"
        best = after if verdict["effects"] else before
        if floor is None:
            if "cannot be told" not in text:
                yield f"no noise floor of {measure}, and the page does not say so"
            continue
        if best["high"] < floor["low"] and "the noise is overestimated" not in text:
            yield f"{measure} lies below its noise floor, and the page does not say so"
    if verdict["effects"] and fit["augmented"]["loglik_per_hit"]["high"] < 0:
        yield "what is named makes held-out hits less likely"
    if not verdict["effects"] and fit["augmented"] is not None:
        same = all(
            (fit["augmented"][m] or {}).get("value") == (fit["refitted"][m] or {}).get("value")
            for m in ERRORS
        )
        if not same:
            yield "nothing is named, but the augmented scene differs from the refitted one"
    for effect in verdict["effects"]:
        if abs(sum(effect["members"].values()) + verdict["unknown"]["probability"] - 1) > 1e-6:
            yield f"probabilities of the class of {effect['name']} do not add up to 1"
        for p in effect["parameters"]:
            if not p["low"] <= p["value"] <= p["high"]:
                yield f"{effect['name']}.{p['name']} lies outside its own interval"
        if effect["name"].replace("_", " ") not in _plain(text).replace("_", " "):
            yield f"{effect['name']} is named, but not on the page"
    for p in re.findall(r"p = ([\d.e-]+)", text):
        if float(p) != float(f"{mismatch['p_value']:.2g}"):
            yield f"the page says p = {p}, verdict.json {mismatch['p_value']}"


def _figures(verdict: dict[str, Any], tables: dict[str, pd.DataFrame]) -> Iterator[str]:
    for name, table in tables.items():
        if "significant" in table and verdict["headline"] == "nothing_found":
            count = int(table["significant"].fillna(False).astype(bool).sum())
            if count:
                yield f"nothing is found, but {name} marks {count} places as unlikely to be chance"
        shown = "scene" in table and (table["scene"] == "augmented").any()
        if shown and not verdict["effects"] and name != "D4-errors":
            yield f"nothing is named, but {name} shows an augmented scene"
    errors = tables.get("D4-errors")
    if errors is not None:
        for row in errors.itertuples():
            said = verdict["fit"][row.scene][row.measure]
            for bound in ("value", "low", "high"):
                if abs(getattr(row, bound) - said[bound]) > 1e-4 * max(abs(said[bound]), 1e-3):
                    yield f"D4-errors has another {row.measure} of {row.scene} than verdict.json"
    ranking = tables.get("D2-ranking")
    if ranking is not None:
        starred = set(ranking["class_of"].dropna())
        named = {effect["name"] for effect in verdict["effects"]}
        if starred != named:
            yield f"D2-ranking marks {sorted(starred)}, verdict.json names {sorted(named)}"


def _named_figures(text: str, folder: Path) -> Iterator[str]:
    for name in re.findall(r"!\[[^]]*\]\(([^)]*)\)", text):
        if not (folder / name).is_file():
            yield f"the page shows {name}, which is not there"


def _augmented(verdict: dict[str, Any], folder: Path) -> Iterator[str]:
    if not (folder / "refit.json").is_file():
        return  # the page and its figures alone
    file = folder / "augmented" / "effects.json"
    held = set(json.loads(file.read_text())) if file.is_file() else set()
    named = {effect["name"] for effect in verdict["effects"]}
    if held != named:
        yield f"augmented/ holds {sorted(held)}, verdict.json names {sorted(named)}"


def _plain(text: str) -> str:
    """Without what Markdown escapes."""
    return re.sub(r"\\(.)", r"\1", text).replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
