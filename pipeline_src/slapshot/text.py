"""External text on one printable line, and tables in Markdown."""

from collections.abc import Sequence

_LONGEST_REASON = 300  # characters


def printable(text: str) -> str:
    """A text that is safe on a terminal: control characters and lone surrogates are escaped."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def reason_of(error: BaseException) -> str:
    """Message of any exception, in one printable line."""
    if isinstance(error, SystemExit):
        return "it calls sys.exit"
    try:
        said = " ".join(str(error).split())
    except Exception:  # __str__ may itself fail
        said = ""
    return printable(said[:_LONGEST_REASON]) or type(error).__name__


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; cells may contain Markdown."""
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *rows))
