"""`python -m slapshot.proof.lists FILE`: draw a list of cases under new seeds of the operating system."""

from pathlib import Path

from slapshot.case_list import draw_command, write_new
from slapshot.proof.cases import write_cases
from slapshot.proof.conditions import LISTS, draw_list


def draw_file(which: str, file: Path) -> None:
    """Draw a list into a file that does not exist yet.

    Raises:
        InputError: the file exists, or cannot be written.
    """
    write_new(file, lambda aside: write_cases(draw_list(LISTS[which], which[0]), aside))


if __name__ == "__main__":
    draw_command("slapshot.proof.lists", LISTS, draw_file)
