"""`python -m slapshot.blind_validation.lists FILE`: draw a list of cases under seeds of the system."""

from pathlib import Path

from slapshot.blind_validation.cases import write_cases
from slapshot.blind_validation.conditions import LISTS, draw_list
from slapshot.case_list import draw_command, write_new


def draw_file(which: str, file: Path) -> None:
    """Draw a list into a file that does not exist yet.

    Raises:
        InputError: the file exists, or cannot be written.
    """
    write_new(file, lambda aside: write_cases(draw_list(LISTS[which], which[0]), aside))


if __name__ == "__main__":
    draw_command("slapshot.blind_validation.lists", LISTS, draw_file)
