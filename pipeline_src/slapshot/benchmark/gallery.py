"""Opening the gallery of hits: seconds, and how they grow with the number of hits."""

import json
import tempfile
from pathlib import Path

import rerun as rr

from slapshot.benchmark.measures import ROUNDS, Measure, seconds
from slapshot.viewer.gallery import serve
from slapshot.viewer.hit_recording import INDEX_FILE, read_index

SHARE = 10  # the small gallery has one hit of so many


def gallery_measures(domain: str, folder: Path) -> list[Measure]:
    """Seconds until the catalogue names all hits, and their ratio to those of a tenth of the hits.

    The ratio is 1 if the number of hits costs nothing, and 10 if nothing else costs.

    Args:
        domain: its name in the configuration.
        folder: of a version of the stage `viewer`.
    """
    with tempfile.TemporaryDirectory() as parent:
        few = Path(parent) / "few"
        _link_some(folder, few)
        open_gallery(few)  # imports, and pages of the files
        # In turns, the best of each: whatever else the machine does slows both alike.
        rounds = [
            (seconds(lambda: open_gallery(folder)), seconds(lambda: open_gallery(few))) for _ in range(ROUNDS)
        ]
    all_seconds, few_seconds = (min(times) for times in zip(*rounds, strict=True))
    return [
        Measure(f"{domain}_gallery_seconds", all_seconds, "s"),
        Measure(f"{domain}_gallery_seconds_ratio_to_a_tenth_of_the_hits", all_seconds / few_seconds, "1"),
    ]


def open_gallery(folder: Path) -> list[str]:
    """Serve a version's hits until the catalogue has answered; the hits' recording ids."""
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
