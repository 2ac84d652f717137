"""Texts from outside on one printable line, and tables in Markdown."""

from collections.abc import Sequence

_LONGEST_REASON = 300  # characters


def printable(text: str) -> str:
    """A text that is safe on a terminal: control characters and half letters as escapes."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def reason_of(error: BaseException) -> str:
    """Why something failed, in one printable line; the error may be anybody's."""
    if isinstance(error, SystemExit):
        return "it calls sys.exit"
    try:
        said = " ".join(str(error).split())
    except Exception:  # its __str__ is anybody's, too
        said = ""
    return printable(said[:_LONGEST_REASON]) or type(error).__name__


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table of cells that are Markdown."""
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *rows))
