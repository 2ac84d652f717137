"""Texts from outside on one printable line."""

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
