"""Owns the comparison of arrays' own metadata, by which other programs read a store, with what was written."""

from __future__ import annotations

from zarr.abc.store import Store

from softclose_store.disk.files import look_at
from softclose_store.read.described import DescribedFiles
from softclose_store.schema.hierarchy import metadata_digest
from softclose_store.schema.root import RUNTIME_KEY, Root
from softclose_store.schema.texts import read_json


def check_metadata(files: DescribedFiles, root: Root) -> None:
    """Raise DamageError where the metadata of an array or a stage are not what was written."""
    keys = sorted(key for key in files.documents if key.endswith("/zarr.json") and key != RUNTIME_KEY)
    contents = {key: look_at(files.inner, key) or b"" for key in keys}
    if metadata_digest(contents) != root.attributes["metadata_digest"]:
        wrong = [key for key in keys if contents[key] != files.documents[key]] or keys
        raise files.damage(wrong[0], "is not what was written" if contents[wrong[0]] else "is missing, or no file")


def is_as_created(files: Store, root: Root) -> bool:
    """Whether the root tells of no run where the group `runtime` does.

    A run is noted in both before it stores anything: beside rows of candidates such a root is the creation's own, put
    in the place of a later one.
    """
    if root.n_committed or root.metadata["runtime"]["attributes"].get("runs"):
        return False
    try:
        return bool(read_json(look_at(files, RUNTIME_KEY) or b"")["attributes"].get("runs"))
    except (ValueError, KeyError, TypeError, AttributeError):
        return False


def age_problem(files: Store, root: Root, known: int) -> str:
    """Why the root is of an earlier time than the tables, an old copy for instance; "" where it is not.

    known: waves that the rows behind the committed ones know of (`RecordTable.waves_beyond`).
    """
    if known > root.n_waves + 1 or (known and is_as_created(files, root)):
        return f"is of an earlier time: it says {root.n_waves} waves, and the tables have {known}"
    return ""
