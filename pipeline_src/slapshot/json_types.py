"""The types of what JSON holds, and of rows of a table."""

from collections.abc import Mapping, Sequence

Json = str | float | bool | None | Sequence["Json"] | Mapping[str, "Json"]
JsonObject = dict[str, Json]

Cell = str | float | bool | None  # an integer is a float here
Row = dict[str, Cell]  # None where a column does not apply
