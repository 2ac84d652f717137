"""A user's regular expression for names of files, matched within a time limit.

Some patterns take practically forever ('^(h+)+!$' against thirty h), and nothing can stop Python's
matching in its own process: so another one does it, which can be ended.
"""

import json
import signal
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from slapshot.errors import InputError
from slapshot.recordings.importing import matcher

# Of a processor's time, whatever else it has to do; thousands of names take milliseconds.
_LIMIT_S = 10


class NamePattern:
    """A regular expression whose named groups become fields.

    Args:
        pattern: as Python's `re` has it.
        where: file, line and key where it stands, for errors.

    Raises:
        InputError: It is no regular expression.
    """

    def __init__(self, pattern: str, where: str) -> None:
        self.pattern, self._where = pattern, where
        self.groups: tuple[str, ...] = tuple(self._ask(())["groups"])

    def fields(self, names: Sequence[str]) -> list[dict[str, str] | None]:
        """Field -> text, for each name; None where the name does not match.

        Raises:
            InputError: Matching does not end.
        """
        found: list[dict[str, str] | None] = self._ask(names)["fields"]
        return found

    def _ask(self, names: Sequence[str]) -> dict[str, Any]:
        done = subprocess.run(
            [sys.executable, "-I", str(matcher.__file__)],
            input=json.dumps([_LIMIT_S, self.pattern, list(names)]),
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode == -signal.SIGXCPU:
            raise InputError(
                f"{self._where}: {self.pattern!r} was not matched within {_LIMIT_S} s; write it without "
                "repetitions in repetitions, such as (a+)+"
            )
        done.check_returncode()
        answer: dict[str, Any] = json.loads(done.stdout)
        if "error" in answer:
            raise InputError(
                f"{self._where}: no regular expression ({answer['error']}); correct it, in single quotes"
            )
        return answer
