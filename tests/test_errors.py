"""What the system refuses, in one line: of Python, of libraries, and where a clean-up hides it."""

import errno
import os
from pathlib import Path

import pytest
from slapshot.errors import InputError, writing

TARGET = Path("data/store/train/0123456789ab")


def raised(error: Exception) -> str:
    with pytest.raises(InputError) as caught, writing(TARGET):
        raise error
    assert caught.value.__cause__ is error
    return str(caught.value)


@pytest.mark.parametrize(
    ("code", "remedy"),
    [
        (errno.ENOSPC, "free some space there, for example with `slapshot versions gc`"),
        (errno.EDQUOT, "free some space there"),
        (errno.EFBIG, "raise the limit on the size of files"),
        (errno.EROFS, "make that file system writable"),
        (errno.EACCES, "make it writable for you"),
        (errno.EPERM, "make it writable for you"),
    ],
)
def test_a_refusal_says_what_where_and_how_to_mend_it(code, remedy):
    message = raised(OSError(code, os.strerror(code)))
    assert message.startswith(f"{TARGET} could not be written: {os.strerror(code)}; {remedy}")
    assert message.endswith(", then run the same command again")
    assert "\n" not in message


def test_the_file_is_named_unless_it_is_the_target():
    assert f" ({TARGET / 'a.csv'}); " in raised(OSError(errno.ENOSPC, "no", str(TARGET / "a.csv")))
    assert "written: No space left on device; " in raised(OSError(errno.ENOSPC, "no", str(TARGET.absolute())))


def test_the_words_of_a_library_in_another_language_are_understood():
    assert "written: No space left on device;" in raised(
        RuntimeError("I/O: No space left on device (os error 28)")
    )


def test_a_clean_up_does_not_hide_what_was_refused():
    def write() -> None:
        try:
            raise OSError(errno.ENOSPC, "no")
        finally:
            raise ValueError("inconsistent stream state")

    with pytest.raises(InputError, match="No space left on device"), writing(TARGET):
        write()


@pytest.mark.parametrize(
    "error", [ValueError("x"), FileNotFoundError(errno.ENOENT, "no"), InputError("x"), KeyboardInterrupt()]
)
def test_other_errors_pass(error):
    with pytest.raises(type(error)) as caught, writing(TARGET):
        raise error
    assert caught.value is error


def test_a_message_is_one_line_that_commands_no_terminal() -> None:
    forged = Path("a\nerror: none") / "\x1b[2Jb" / "\u202ec" / "\udcff"
    message = str(InputError(f"{forged}: is missing"))
    assert message == "a\\nerror: none/\\x1b[2Jb/\\u202ec/\\udcff: is missing"
