"""Owns opening the root: nothing that it says is believed before it is checked against the schema (docs/adr/084)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from zarr.abc.store import Store

from softclose_store.disk.files import list_keys, look_at, read_key, write_key
from softclose_store.disk.names import is_chunk_key, is_safe
from softclose_store.errors import DamageError, StoreMissingError
from softclose_store.schema.documents import (
    GroupArrayDocument,
    ListedDocument,
    RootDocument,
    RuntimeDocument,
    checked,
)
from softclose_store.schema.hierarchy import TABLES, schema_of
from softclose_store.schema.layout import Layout, check_schema
from softclose_store.schema.root import BACKUP_KEY, KIND, ROOT_KEY, SCHEMA_ATTRIBUTE, Root
from softclose_store.schema.texts import read_json


@lru_cache(maxsize=4)
def decode_root(content: bytes, where: str) -> Root:
    """The root that these bytes say; the same bytes are checked once, as a command opens its store several times.

    Parameters
    ----------
    content : bytes
        Of the file.
    where : str
        The store, for messages.

    Returns
    -------
    Root
        Of the schema's types, within its bounds, with the metadata that its layout has.

    Raises
    ------
    StoreMissingError
        For the root of another hierarchy.
    SchemaError
        For another schema version.
    DamageError
        For what cannot be read, is not what was written, or is no root of a store.
    """
    try:
        document = read_json(content)
        attributes = document["attributes"]
        is_ours = attributes.get("kind") == KIND
    except (ValueError, KeyError, AttributeError, TypeError) as e:
        raise DamageError(
            f"{where}/zarr.json cannot be read as JSON metadata ({type(e).__name__}: {e}): the file is damaged: "
            f"`softclose verify {where} --repair` rebuilds it; or the path is no Softclose store"
        ) from e
    if not is_ours:
        raise StoreMissingError(f"{where} is a Zarr hierarchy, but no Softclose campaign; give another path")
    check_schema(attributes.get(SCHEMA_ATTRIBUTE), where)
    root = Root(document)
    if root.encode() != content:
        raise DamageError(
            f"{where}/zarr.json is not what was written (its own digest differs): "
            f"`softclose verify {where} --repair` rebuilds it"
        )
    try:
        checked(RootDocument, document)
        _check_metadata(root)
    except ValueError as e:
        raise DamageError(
            f"{where}/zarr.json is no root of a store: {e}: `softclose verify {where} --repair` rebuilds it"
        ) from e
    return root


def layout_without_times(data: Mapping[str, Any]) -> Layout:
    """The sizes that a root says, with any time grid of as many instants."""
    return Layout.from_dict(data, np.arange(float(data["n_times"])))


def _check_metadata(root: Root) -> None:
    """Raise ValueError where what the root says of an array is not what its layout's array has: size, type, codecs."""
    data = root.attributes["layout"]
    schema = read_json(schema_of(layout_without_times(data))[ROOT_KEY])
    empty = Root({**schema, "attributes": {"layout": data}})
    expected = empty.committed(root.n_committed, root.n_waves, root.attributes["hyperparameters"]).metadata
    check_listing(root.listed)
    for name in sorted(expected.keys() ^ root.metadata.keys()):
        raise ValueError(f"{name} is {'no array of its layout' if name in root.metadata else 'missing'}")
    for name, entry in root.metadata.items():
        if name == "runtime":
            checked(RuntimeDocument, entry.get("attributes"))
            entry = {**entry, "attributes": expected[name]["attributes"]}
        if entry != expected[name]:
            wrong = [
                part
                for part in sorted(entry.keys() | expected[name].keys())
                if entry.get(part) != expected[name].get(part)
            ]
            raise ValueError(f"{', '.join(wrong)} of {name} are not those of the schema")


def check_listing(listed: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise ValueError where what a root says of result groups is none: of what kind, how large, by which codecs."""
    for name, entry in listed.items():
        if not is_safe(name):
            raise ValueError(f"{name!r} is no name of a result group")
        try:
            if entry.get("node_type") == "array":
                checked(GroupArrayDocument, entry)
            else:
                checked(ListedDocument, entry)
        except ValueError as e:
            raise ValueError(f"{name}: {e}") from e


def read_root(files: Store, where: str) -> Root:
    """Read and check the root; raises StoreMissingError where there is no store, DamageError where its root is gone."""
    content = read_key(files, ROOT_KEY)
    if content is not None:
        return decode_root(content, where)
    begun = any(look_at(files, f"{name}/zarr.json") is not None for name in TABLES)
    if look_at(files, BACKUP_KEY) is not None or (begun and _holds_data(files)):
        raise DamageError(
            f"{where} holds a campaign but no zarr.json at its root: that file was lost; "
            f"`softclose verify {where} --repair` rebuilds it"
        )
    if begun:
        raise StoreMissingError(
            f"{where} holds an unfinished creation of a store (no zarr.json at its root, and no data): nothing is "
            "lost, delete it and run again"
        )
    raise StoreMissingError(f"there is no campaign at {where}: check the path, or start one with `softclose run`")


def _holds_data(files: Store) -> bool:
    """True where a candidate was stored: the creation alone writes no table and no block."""
    written = tuple(f"{name}/c." for name in TABLES)
    return any(key.startswith(written) or (is_chunk_key(key) and "/block_digest/" in key) for key in list_keys(files))


def write_root(files: Store, root: Root) -> None:
    """Replace the root atomically: this is the commit."""
    write_key(files, ROOT_KEY, root.encode())
