"""verdict.json: what it holds, how it is checked, written and read back."""

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

from pydantic import create_model, model_validator

from slapshot.diagnosis.pucks.verdict import Text, Verdict
from slapshot.errors import InputError
from slapshot.validation import Model, read_json, validated
from slapshot.whole_file import write_whole

VERDICT_FILE = "verdict.json"
SCENES = {"nominal", "refitted", "augmented", "noise_floor"}  # of which there are errors


class _Whole(Model):
    """Either there is a verdict, or the reason why there is none."""

    @model_validator(mode="after")
    def _told_or_not(self) -> "_Whole":
        untold = self.cannot_tell is not None  # type: ignore[attr-defined]
        for key in ("mismatch", "location", "unknown", "fit"):
            if (getattr(self, key) is None) is not untold:
                said, needed = ("a text", "be null") if untold else ("null", "hold what was found")
                raise ValueError(f"where cannot_tell is {said}, {key} must {needed}")
        if (self.headline == "cannot_tell") is not untold:  # type: ignore[attr-defined]
            raise ValueError("headline is cannot_tell just where cannot_tell says why")
        if self.used > self.hits:  # type: ignore[attr-defined]
            raise ValueError("used is more than hits; write at most as many")
        if bool(self.effects) != (self.headline == "found"):  # type: ignore[attr-defined]
            raise ValueError("effects are named just where headline is found")
        if not untold:
            self._consistent()
        return self

    def _consistent(self) -> None:
        """What was found goes together.

        Raises:
            ValueError: it does not.
        """
        mismatch, fit = self.mismatch, self.fit  # type: ignore[attr-defined]
        if mismatch.found is not (self.headline != "nothing_found"):  # type: ignore[attr-defined]
            raise ValueError("mismatch.found is false just where headline is nothing_found")
        if set(fit) != SCENES:
            raise ValueError(f"fit has {', '.join(sorted(fit))}; write {', '.join(sorted(SCENES))}")
        for errors in fit.values():
            for interval in vars(errors).values():
                if interval is not None and not interval.low <= interval.value <= interval.high:
                    raise ValueError("fit holds a value outside its interval; write low <= value <= high")


# The fields of the verdict, all of which a file must have, and the versions that it came from.
_TYPES = get_type_hints(Verdict, include_extras=True)
_FIELDS: dict[str, Any] = {field.name: (_TYPES[field.name], ...) for field in fields(Verdict)}
VerdictFile = create_model("VerdictFile", __base__=_Whole, **_FIELDS, versions=(dict[str, Text], ...))


def write_verdict(verdict: Verdict, versions: Mapping[str, str], folder: Path) -> None:
    """Check a verdict and write verdict.json.

    Args:
        verdict: numbers in it must be finite; what has no value is null.
        versions: of scene, code and recording, and whatever else it came from.
        folder: that exists.

    Raises:
        ValueError: the verdict is none that could be read again, or holds NaN or an infinity.
    """
    # NumPy's numbers become JSON's; NaN and infinities raise.
    text = json.dumps({**verdict.as_dict(), "versions": dict(versions)}, indent=2, allow_nan=False)
    try:
        validated(VerdictFile, json.loads(text), "verdict")
    except InputError as error:
        raise ValueError(str(error)) from None
    write_whole(folder / VERDICT_FILE, text + "\n")


def read_verdict(folder: Path) -> tuple[Verdict, dict[str, str]]:
    """A verdict and the versions that it came from.

    Raises:
        InputError: there is no verdict.json, or it is not what `write_verdict` writes.
    """
    file = folder / VERDICT_FILE
    values = read_json(file, "diagnose the recording first")
    try:
        found = validated(VerdictFile, values, file)
    except InputError as error:
        raise InputError(f"{error}; or diagnose the recording again") from None
    kept = {field.name: getattr(found, field.name) for field in fields(Verdict)}
    return Verdict(**kept), found.versions  # type: ignore[attr-defined]
