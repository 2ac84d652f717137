"""Name of a broken recording -> how it is broken, and words that its error must hold."""

import numpy as np
import pandas as pd
import pyarrow as pa

from .breakers import (
    Breaker,
    a_file_instead,
    arrow,
    both,
    cell,
    change_one_command,
    drop_one_command,
    empty_folder,
    header,
    infinite_rate,
    lost_link,
    one_latent,
    puck,
    remove_folder,
    same_time,
    scaled,
    swap_times,
    table,
    text,
    typed,
    without,
)
from .builder import TABLES

no_rest = table("hits", lambda frame: frame.assign(rest_x=np.nan, rest_y=np.nan, latent=None))
no_latents = table("hits", lambda frame: frame.assign(latent=None))
no_others = without("tracks.parquet", "commands.parquet", "joints.parquet")
half_second = pd.Timestamp("1970-01-01 00:29", tz="UTC")

CASES: dict[str, tuple[Breaker, list[str]]] = {
    "folder missing": (remove_folder, ["recording: folder is missing", "check the path"]),
    "folder empty": (empty_folder, ["recording: folder is empty"]),
    "folder is a file": (a_file_instead, ["is not a folder"]),
    # recording.json
    "no header": (
        without("recording.json"),
        ["recording.json: no such file; put the recording's recording.json there"],
    ),
    "not JSON": (text("{rig: 3"), ["recording.json: is not valid JSON", "line 1 column 2"]),
    "empty header": (text(""), ["is not valid JSON"]),
    "not UTF-8": (text(b'{"rig": "\xff"}'), ["is not valid JSON"]),
    "NaN in JSON": (text('{"camera_rate_hz": NaN}'), ["NaN is not a JSON number"]),
    "key twice": (text('{"rig": "a", "rig": "b"}'), ["key 'rig' stands there twice"]),
    "half a character": (text('{"rig": "\\ud800"}'), ["is not valid JSON"]),
    "deep JSON": (text("[" * 100_000), ["is not valid JSON"]),
    "a list": (text("[1, 2]"), ["recording.json: top level: [1, 2] is not a mapping; write a mapping"]),
    "no version": (header(format_version=None), ["'format_version' is missing"]),
    "next version": (
        both(header(format_version=3, new_key=1)),
        ["format_version is 3", "reads version 1, 2"],
    ),
    "version of another kind of recording": (
        header(format_version=2),
        [
            "format_version is 2 (joints and bodies)",
            "needs a recording of version 1 (hits of a sliding object)",
        ],
    ),
    "version true": (header(format_version=True), ["format_version is True"]),
    "version text": (header(format_version="1"), ["format_version is '1'"]),
    "unknown key": (header(camera_rate=50), ["unknown key 'camera_rate'", "camera_rate_hz"]),
    "key missing": (header(rig=None), ["key 'rig' is missing", "name of the set-up"]),
    "rate text": (
        header(camera_rate_hz="50"),
        ["camera_rate_hz: '50' is not a number; write a number such as 50.0"],
    ),
    "rate zero": (header(camera_rate_hz=0), ["camera_rate_hz: 0 is out of range; it must be > 0"]),
    "rate infinite": (infinite_rate, ["camera_rate_hz: inf is not a finite number; write one"]),
    "stand_in a number": (header(stand_in=1), ["stand_in: 1 is not a true or false; write a true or false"]),
    "empty rig": (header(rig=""), ["rig: '' is empty; write a text (name of the set-up)"]),
    "no objects": (header(objects={}), ["objects: is empty; add at least 1"]),
    "bad digest": (
        header(sealed_truth_sha256="abc"),
        ["sealed_truth_sha256: 'abc' is not allowed; use what matches"],
    ),
    "object key unknown": (puck(colour="red"), ["objects.ice.colour: unknown key 'colour'; remove it"]),
    "object key missing": (
        puck(mass_kg=None),
        ["objects.ice: key 'mass_kg' is missing; add it (measured mass in kg"],
    ),
    "object mass text": (
        puck(mass_kg="heavy"),
        ["objects.ice.mass_kg: 'heavy' is not a number; write a number"],
    ),
    "object size": (
        puck(size_m=[0.1, -1]),
        ["objects.ice.size_m.1: -1 is out of range; it must be >= 0.0001"],
    ),
    "size in millimetres": (puck(size_m=[76, 25]), ["objects.ice.size_m", "divide by 1000"]),
    "mass in grams": (puck(mass_kg=160), ["objects.ice.mass_kg", "grams", "divide by 1000"]),
    # Columns and types
    "no hits table": (without("hits.parquet"), ["hits.parquet: is missing"]),
    "lost link": (lost_link, ["tracks.parquet: no such file; put a Parquet file there, or remove it"]),
    "column missing": (
        table("hits", lambda frame: frame.drop(columns="start_x")),
        ["hits.parquet: column 'start_x' is missing", "in m"],
    ),
    "joint missing": (
        table("commands", lambda frame: frame.drop(columns="q2")),
        ["commands.parquet: column 'q2' is missing although 'q3'"],
    ),
    "no joints": (
        table("joints", lambda frame: frame[["hit", "t"]]),
        ["joints.parquet: column 'q0' is missing"],
    ),
    "column unknown": (
        table("tracks", lambda frame: frame.assign(z=0.0)),
        ["tracks.parquet: column 'z' is not in the format", "remove it"],
    ),
    "joint column unknown": (
        table("commands", lambda frame: frame.assign(q07=0.0)),
        ["commands.parquet: column 'q07' is not in the format"],
    ),
    "index written": (
        table("tracks", lambda frame: frame.assign(__index_level_0__=0)),
        ["'__index_level_0__'", "index=False"],
    ),
    "text for numbers": (typed("tracks", "x", str), ["column 'x'", "not a float", "convert"]),
    "number for text": (
        table("hits", lambda frame: frame.assign(object_id=1)),
        ["column 'object_id' has type int64, not text"],
    ),
    "bool for number": (typed("tracks", "x", bool), ["column 'x' has type bool"]),
    "number for a list": (
        table("hits", lambda frame: frame.assign(latent=0.5)),
        ["column 'latent' has type double, not a list of floats"],
    ),
    "no time zone": (
        table("hits", lambda f: f.assign(recorded_at=f["recorded_at"].dt.tz_localize(None))),
        ["column 'recorded_at'", "time zone"],
    ),
    "fraction of a hit": (
        table("tracks", lambda f: f.assign(hit=f["hit"] + 0.5)),
        ["tracks.parquet: row 0 ", "'hit' is 10.5, not a whole number"],
    ),
    "fraction of a command": (
        table("hits", lambda f: f.assign(command_id=[0.0, 1, 1.5, 0, 1, 2])),
        ["row 2 ", "column 'command_id' is 1.5, not a whole number"],
    ),
    "too large for an integer": (
        table("hits", lambda f: f.assign(command_id=[0.0, 1, 1e300, 0, 1, 2])),
        ["row 2 ", "'command_id'", "not a whole number"],
    ),
    # Values
    "null": (cell("tracks", 7, "x", np.nan), ["row 7 ", "'x' is empty (null or NaN)"]),
    "null text": (cell("hits", 1, "object_id", None), ["row 1 ", "'object_id' is empty (null)"]),
    "null hit": (
        arrow("tracks", "hit", lambda c: pa.array([None, *c.to_pylist()[1:]])),
        ["tracks.parquet: row 0 ", "'hit' is empty"],
    ),
    "NaN": (
        arrow("joints", "q1", lambda c: pa.array([0.0, np.nan, *c.to_pylist()[2:]])),
        ["joints.parquet: row 1 ", "'q1' is NaN"],
    ),
    "infinite": (cell("commands", 9, "q6", np.inf), ["row 9 ", "'q6' is infinite"]),
    "infinite rest": (cell("hits", 2, "rest_x", -np.inf), ["row 2 ", "'rest_x' is infinite"]),
    "infinite yaw": (cell("tracks", 5, "yaw", np.inf), ["row 5 ", "'yaw' is infinite"]),
    "NaN time": (cell("tracks", 5, "t", np.nan), ["row 5 ", "'t' is empty"]),
    "half a rest point": (
        cell("hits", 3, "rest_y", np.nan),
        ["row 3 ", "hit 13", "rest_x is given but rest_y is null"],
    ),
    "date of another unit": (
        cell("hits", 2, "recorded_at", half_second),
        ["row 2 ", "recorded_at is not between"],
    ),
    # Hits
    "no hits": (table("hits", lambda frame: frame.iloc[:0]), ["hits.parquet: has no hits"]),
    "duplicate hits": (cell("hits", 4, "hit", 11), ["duplicate hit 11 in rows 1 and 4"]),
    "unknown object": (
        cell("hits", 4, "object_id", "tennis ball"),
        ["row 4 ", "hit 14", "'tennis ball' is not among the objects"],
    ),
    **{
        f"unknown hit in {name}": (
            cell(name, 3, "hit", 99),
            [f"{name}.parquet: row 3 ", "hit 99 is not in hits.parquet"],
        )
        for name in TABLES[1:]
    },
    **{
        f"no rows in {name}": (
            table(name, lambda frame: frame.iloc[:0]),
            [f"{name}.parquet: has no rows"],
        )
        for name in TABLES[1:]
    },
    # Time
    "backwards": (table("tracks", swap_times), ["row 14 ", "hit 11", "time goes backwards"]),
    "twice": (table("tracks", same_time), ["row 14 ", "hit 11", "the same time twice"]),
    "commands backwards": (
        table("commands", swap_times),
        ["commands.parquet: row 14 ", "hit 12", "time goes backwards"],
    ),
    "negative time": (cell("joints", 0, "t", -0.1), ["row 0 ", "hit 10", "before the hit's start"]),
    # Units
    "start in millimetres": (
        scaled("hits", ["start_x", "start_y"], 1000),
        ["hits.parquet: columns 'start_x' and 'start_y'", "divide by 1000"],
    ),
    "rest in millimetres": (
        scaled("hits", ["rest_x", "rest_y"], 1000),
        ["'rest_x' and 'rest_y'", "millimetres", "divide by 1000"],
    ),
    "travel of a hall": (
        table("hits", lambda f: f.assign(start_x=-15.0, rest_x=f["rest_x"] + 10)),
        ["from start to rest", "divide by 1000"],
    ),
    "tracks in millimetres": (
        scaled("tracks", ["x", "y"], 1000),
        ["tracks.parquet: columns 'x' and 'y'", "millimetres", "divide by 1000"],
    ),
    "q in degrees": (
        scaled("commands", ["q0", "q1", "q2"], 180 / np.pi),
        ["commands.parquet: column 'q0'", "degrees", "pi/180"],
    ),
    "yaw in degrees": (
        table("tracks", lambda frame: frame.assign(yaw=-45.0)),
        ["tracks.parquet: column 'yaw'", "degrees"],
    ),
    "tracks in milliseconds": (
        scaled("tracks", ["t"], 1000),
        ["tracks.parquet: column 't'", "milliseconds", "divide by 1000", "camera_rate_hz"],
    ),
    "camera rate in kilohertz": (
        header(camera_rate_hz=0.001),
        ["camera_rate_hz in recording.json is 0.001", "correct the rate"],
    ),
    "tracks in hours": (scaled("tracks", ["t"], 1 / 3600), ["column 't'", "give t in seconds"]),
    "commands in milliseconds": (
        scaled("commands", ["t"], 1000),
        ["commands.parquet: column 't'", "milliseconds", "divide by 1000"],
    ),
    # Latents and repeats
    "unequal latents": (
        one_latent(3, np.zeros(3)),
        ["row 3 ", "hit 13", "has length 3, that of hit 10 has 2"],
    ),
    "NaN latent": (one_latent(3, np.array([0.0, np.nan])), ["row 3 ", "hit 13", "latent", "NaN"]),
    "one latent missing": (one_latent(3, None), ["row 3 ", "hit 13", "null, others are not"]),
    "empty latents": (
        table("hits", lambda f: f.assign(latent=[np.zeros(0)] * len(f))),
        ["at least 1"],
    ),
    "latents of no model": (header(trajectory_model=None), ["'latent'", "'trajectory_model'"]),
    "nothing to use": (both(no_rest, no_others), ["nothing to use"]),
    "no outcome": (
        both(no_rest, without("tracks.parquet")),
        ["nothing to use", "no tracks.parquet", "no rest point"],
    ),
    "no cause": (both(no_latents, no_others), ["nothing to use", "commands.parquet", "'latent'"]),
    "repeats that are none": (
        table("commands", change_one_command),
        ["commands.parquet: hits 11 and 14", "command_id 1", "differ by 1e-06"],
    ),
    "repeats of other length": (
        table("commands", drop_one_command),
        ["hits 11 and 14", "command_id 1", "5 and 4 rows"],
    ),
    "fewer joints measured": (
        table("joints", lambda frame: frame.drop(columns="q6")),
        ["joints.parquet: has 6 joint columns, commands.parquet has 7"],
    ),
}
