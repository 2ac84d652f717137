"""The gallery of hits: a catalogue server on this machine and the cards it shows.

Rerun marks as unstable all that is used here (rerun.server, rerun.catalog, rerun.blueprint.table); no other
module uses any of it.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from slapshot.errors import InputError
from slapshot.viewer.bodies import TIME
from slapshot.viewer.hit_recording import CARDS_FILE, LAYOUT_FILE, SCENE_FILE, read_index

HOST = "127.0.0.1"  # Rerun's default is every interface
_LINK = "recording link"  # the viewer's own column of a dataset's table
_NAME = "rerun_segment_id"
_TITLE = "property:RecordingInfo:name"
_FIELDS = {
    "note": "what it is",
    "error_before_cm": "cm off before",
    "error_after_cm": "after",
    "hits_seen": "hits seen",
}


def save_cards(path: Path, application: str, view: rrb.View) -> None:
    """Write how the gallery looks: a card a hit, with `view` of it, which can be played."""
    facts = [rrb.table.Column(f"property:hit:{key}", name=label) for key, label in _FIELDS.items()]
    title = rrb.table.Column(_TITLE, name="hit")
    picture = rrb.table.PreviewCell(view)
    rrb.TableBlueprint(
        card_layout=rrb.table.CardLayout(
            title=_TITLE,
            link=_LINK,
            fields=[rrb.table.Column(_LINK, name="recording", column_type=picture), *facts],
        ),
        table_layout=rrb.table.TableLayout(columns=[title, rrb.table.Column(_LINK), *facts]),
        default_layout="cards",
        sort_by=_NAME,
        # Pictures that stand still show how the hit ended.
        previews_config=rrb.table.PreviewsConfig(timeline=TIME, start_point=0.6),
    ).save(application, path)


@contextmanager
def serve(folders: Mapping[str, Path], port: int) -> Iterator[str]:
    """Serve versions of the stage `viewer`, on this machine only, for as long as the block lasts.

    Rerun's server asks for no password and has no check of the Host header, nor an option for one: other
    users of this machine can connect, and pages whose address is pointed at this machine (DNS rebinding).
    A relay with such a check would leave the server behind it open at another port. Pages of other sites
    may not read its answers, because it allows no origins but this machine and rerun.io.

    Args:
        folders: name of a gallery -> folder of a version.
        port: to listen on; 0 for any that is free.

    Yields:
        Address that a Rerun viewer opens.

    Raises:
        InputError: the port is taken.
    """
    try:
        server = rr.server.Server(host=HOST, port=port)
    except Exception as error:  # Rerun raises what its own errors happen to be
        raise InputError(f"browse: cannot listen on {HOST}:{port} ({error}); give another --port") from None
    with server:
        client = server.client()
        for name, folder in folders.items():
            address = _register(client, name, folder.absolute())
        yield address if len(folders) == 1 else server.url()


def _register(client: rr.catalog.CatalogClient, name: str, folder: Path) -> str:
    """Tell the catalogue of a version's hits; return the address of their gallery."""
    dataset = client.create_dataset(name)
    files = [folder / hit["file"] for hit in read_index(folder)["hits"]]
    dataset.register([file.as_uri() for file in files]).wait()
    dataset.register_asset((folder / SCENE_FILE).as_uri())
    dataset.register_blueprint((folder / LAYOUT_FILE).as_uri())
    dataset.register_blueprint((folder / CARDS_FILE).as_uri(), segment_table=True)
    return f"{client.url}/entry/{dataset.id}"
