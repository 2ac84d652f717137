"""Matches names with a regular expression; a script on its own, which `name_pattern` runs and ends.

It reads [limit in seconds, pattern, names] as JSON and writes {"groups": names of groups, "fields": of each
name, null where it does not match}, or {"error": text}. Only the standard library: it starts in milliseconds.
"""

import json
import re
import resource
import sys
from typing import Any


def answer(pattern: str, names: list[str]) -> dict[str, Any]:
    """What is written."""
    try:
        compiled = re.compile(pattern)
    except (re.error, RecursionError, OverflowError, MemoryError) as error:
        return {"error": str(error) or type(error).__name__}
    matches = [compiled.search(name) for name in names]
    return {
        "groups": list(compiled.groupindex),
        "fields": [
            match and {key: text or "" for key, text in match.groupdict().items()} for match in matches
        ],
    }


if __name__ == "__main__":
    limit, *asked = json.load(sys.stdin)
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 1))
    json.dump(answer(*asked), sys.stdout)
