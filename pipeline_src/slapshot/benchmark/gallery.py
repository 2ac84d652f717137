"""Time to open the gallery of hits, and how it grows with the number of hits."""

import json
import tempfile
from pathlib import Path

import rerun as rr

from slapshot.benchmark.measures import ROUNDS, Measure, seconds
from slapshot.viewer.gallery import serve
from slapshot.viewer.hit_recording import INDEX_FILE, read_index

SHARE = 10  # the small gallery has a SHARE-th of the hits


def gallery_measures(domain: str, folder: Path) -> list[Measure]:
    """Seconds until the catalogue lists all hits, and their ratio to the seconds for a tenth of the hits.

    The ratio is 1 if the time does not depend on the number of hits, and 10 if it is proportional to it.

    Args:
        domain: its name in the configuration.
        folder: of a version of the stage `viewer`.
    """
    with tempfile.TemporaryDirectory() as parent:
        few = Path(parent) / "few"
        _link_some(folder, few)
        open_gallery(few)  # warm up: imports, and the file cache
        # Interleaved, minimum of each: load from other processes then slows both alike.
        rounds = [
            (seconds(lambda: open_gallery(folder)), seconds(lambda: open_gallery(few))) for _ in range(ROUNDS)
        ]
    all_seconds, few_seconds = (min(times) for times in zip(*rounds, strict=True))
    return [
        Measure(f"{domain}_gallery_seconds", all_seconds, "s"),
        Measure(f"{domain}_gallery_seconds_ratio_to_a_tenth_of_the_hits", all_seconds / few_seconds, "1"),
    ]


def open_gallery(folder: Path) -> list[str]:
    """Serve a version's hits until the catalogue has answered; return the recording ids of the hits."""
    with serve({"hits": folder}, 0) as address:
        client = rr.catalog.CatalogClient(address.partition("/entry")[0])
        return client.get_dataset("hits").segment_ids()


def _link_some(folder: Path, target: Path) -> None:
    """Make `target` a version with the first tenth of the hits, by links to the files of `folder`."""
    target.mkdir()
    for path in folder.iterdir():
        if path.name != INDEX_FILE:
            (target / path.name).symlink_to(path.absolute())
    index = read_index(folder)
    some = index["hits"][: max(1, len(index["hits"]) // SHARE)]
    (target / INDEX_FILE).write_text(json.dumps(index | {"hits": some}))
