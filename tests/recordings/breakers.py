"""Ways to break a valid recording on disk: each takes its folder."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from .builder import make_recording

Breaker = Callable[[Path], None]


def table(name: str, change: Callable[[pd.DataFrame], pd.DataFrame | None]) -> Breaker:
    """Breaks one table as a user with pandas would; `change` edits in place or returns another."""

    def breaker(folder: Path) -> None:
        frame = getattr(make_recording(), name)
        changed = change(frame)
        (frame if changed is None else changed).to_parquet(folder / f"{name}.parquet", index=False)

    return breaker


def cell(name: str, row: int, column: str, value: Any) -> Breaker:
    def change(frame: pd.DataFrame) -> None:
        frame.loc[row, column] = value

    return table(name, change)


def scaled(name: str, columns: list[str], factor: float) -> Breaker:
    def change(frame: pd.DataFrame) -> None:
        frame[columns] *= factor

    return table(name, change)


def typed(name: str, column: str, type_: Any) -> Breaker:
    return table(name, lambda frame: frame.astype({column: type_}))


def arrow(name: str, column: str, values: Callable[[pa.ChunkedArray], pa.Array]) -> Breaker:
    """Breaks a column in a way that pandas cannot write."""

    def breaker(folder: Path) -> None:
        file = folder / f"{name}.parquet"
        old = pq.read_table(file)
        index = old.schema.get_field_index(column)
        pq.write_table(old.set_column(index, column, values(old[column])), file)

    return breaker


def header(**changes: Any) -> Breaker:
    """Sets keys of recording.json; None removes one."""

    def breaker(folder: Path) -> None:
        content = json.loads((folder / "recording.json").read_text())
        content.update(changes)
        content = {key: value for key, value in content.items() if value is not None}
        (folder / "recording.json").write_text(json.dumps(content))

    return breaker


def puck(**changes: Any) -> Breaker:
    """The header with one object that has other properties; None removes one."""
    info = {"shape": "cylinder", "size_m": [0.076, 0.025], "mass_kg": 0.1, "mass_sd_kg": 0.0}
    info = {key: value for key, value in (info | changes).items() if value is not None}
    return header(objects={"ice": info, "inline": info})


def text(content: str | bytes) -> Breaker:
    def breaker(folder: Path) -> None:
        raw = content.encode() if isinstance(content, str) else content
        (folder / "recording.json").write_bytes(raw)

    return breaker


def without(*names: str) -> Breaker:
    def breaker(folder: Path) -> None:
        for name in names:
            (folder / name).unlink()

    return breaker


def both(*breakers: Breaker) -> Breaker:
    def breaker(folder: Path) -> None:
        for one in breakers:
            one(folder)

    return breaker


def remove_folder(folder: Path) -> None:
    empty_folder(folder)
    folder.rmdir()


def empty_folder(folder: Path) -> None:
    for path in folder.iterdir():
        path.unlink()


def a_file_instead(folder: Path) -> None:
    remove_folder(folder)
    folder.write_text("")


def lost_link(folder: Path) -> None:
    (folder / "tracks.parquet").unlink()
    (folder / "tracks.parquet").symlink_to("gone")


def infinite_rate(folder: Path) -> None:
    """The one way to write infinity in JSON."""
    file = folder / "recording.json"
    file.write_text(file.read_text().replace("50.0", "1e999"))


def swap_times(frame: pd.DataFrame) -> None:
    frame.loc[[13, 14], "t"] = frame.loc[[14, 13], "t"].to_numpy()


def same_time(frame: pd.DataFrame) -> None:
    frame.loc[14, "t"] = frame.loc[13, "t"]


def drop_one_command(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.drop(index=frame.index[frame["hit"] == 14][-1:])


def change_one_command(frame: pd.DataFrame) -> None:
    frame.loc[frame["hit"] == 14, "q3"] += 1e-6


def one_latent(row: int, value: Any) -> Breaker:
    def change(frame: pd.DataFrame) -> None:
        frame["latent"] = [value if i == row else old for i, old in enumerate(frame["latent"])]

    return table("hits", change)
