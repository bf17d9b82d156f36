"""Owns the list of result groups in the root, by which trees of xarray show them.

Only who holds the one-driver lock writes the root. So a group is written first, as a whole, and listed then: by who
wrote it where the lock is free, else by the driver when it gives the lock back, and by whoever next opens the store for
writing. A group that is not listed yet is whole all the same, to our own reader and in `verify`; a list that names what
is not there would have readers take fill values for data, and is damage.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from zarr.abc.store import Store

from softclose_store.disk.files import StorePath, list_keys, look_at, normalised, open_files
from softclose_store.disk.lock import DriverLock, lock_holder
from softclose_store.disk.names import is_safe, ways
from softclose_store.errors import LockedError
from softclose_store.schema import digests
from softclose_store.schema.documents import GroupArrayDocument, checked
from softclose_store.schema.group_metadata import BY_HAND, COPY_NAME, OWN, GroupMetadata, decode
from softclose_store.schema.opening import read_root, write_root
from softclose_store.schema.root import Root
from softclose_store.schema.texts import read_json

PLAIN_GROUP: dict[str, Any] = {"attributes": {}, "zarr_format": 3, "node_type": "group"}
"""Metadata of a group that only holds result groups, such as `certification`."""

MOST_LISTED = 4_000_000
"""Most bytes of all that is listed: a root of eight million is no root. Groups beyond are opened by their own path."""

PATIENCE_S = 0.5
"""How long a writer of a group waits for the lock: two of them hold it for milliseconds, a driver for hours."""

Listing = dict[str, dict[str, Any]]


def found_groups(files: Store, root: Root) -> Listing:
    """What the root should list: the metadata of every whole result group that has arrays, and of what they lie in.

    Parameters
    ----------
    files : Store
        Of the store.
    root : Root
        As it is: what it lists of a group whose metadata have not changed since is taken from it.
    """
    keys = list_keys(files, skip=root.is_own)
    names = sorted({key.rpartition("/")[0].rpartition("/")[0] for key in keys if key.endswith(f"/{COPY_NAME}")})
    listing: Listing = {}
    size = 0
    for name in names:
        own = decode(look_at(files, f"{name}/zarr.json"), name) if name and is_safe(name) else None
        entries = None if own is None else _kept(root, own) or _read(files, own)
        size += len(json.dumps(entries))
        if entries is not None and size <= MOST_LISTED:
            listing |= {parent: dict(PLAIN_GROUP) for parent in ways(name)[:-1]} | entries
    return listing


def _kept(root: Root, own: GroupMetadata) -> Listing | None:
    listed = root.listed
    before = listed.get(own.name, {}).get("attributes", {}).get(OWN)
    if before != own.document["attributes"][OWN]:
        return None
    return {name: entry for name, entry in listed.items() if name == own.name or name.startswith(f"{own.name}/")}


def _read(files: Store, own: GroupMetadata) -> Listing | None:
    """The metadata of a group and its arrays; None where one of them is not what was written."""
    attributes = {**own.attributes, OWN: own.document["attributes"][OWN]}
    entries: Listing = {own.name: {**PLAIN_GROUP, "attributes": attributes}}
    for member, expected in own.files.items():
        array, _, last = member.rpartition("/")
        if last != "zarr.json":
            continue
        content = look_at(files, f"{own.name}/{member}")
        if content is None or digests.sha256(content) != expected:
            return None
        try:
            document = read_json(content)
            checked(GroupArrayDocument, document)
        except ValueError:
            return None
        entries[f"{own.name}/{array}"] = document
    return entries


def listed_anew(files: Store, root: Root) -> Root:
    """The root that lists what there is, written where it did not; `root` is what lies there, and the lock is held.

    What was changed by hand stays listed where it is lost: nothing else would say that it was there.
    """
    kept = {name: entry for name, entry in root.listed.items() if name.partition("/")[0] == BY_HAND}
    listing = kept | found_groups(files, root)
    if listing == root.listed:
        return root
    root = root.listing(listing)
    write_root(files, root)
    return root


def list_groups_again(path: StorePath, *, but: str = "") -> None:
    """List what there is, where the lock is free; else its holder does when it gives it back.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.
    but : str
        A group to leave out, because it is about to be replaced.
    """
    with _lock_if_free(path) as is_held:
        if not is_held:
            return
        where = normalised(path)
        root = read_root(open_files(path, read_only=True), where)
        files = open_files(path, read_only=False, durable=bool(root.attributes["durable"]))
        if but and but in root.listed:
            kept = {name: e for name, e in root.listed.items() if name != but and not name.startswith(f"{but}/")}
            write_root(files, root.listing(kept))
        elif not but:
            listed_anew(files, root)


@contextmanager
def _lock_if_free(path: StorePath) -> Iterator[bool]:
    lock = DriverLock(path)
    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            lock.acquire()
            break
        except LockedError:
            holder = lock_holder(path)
            if time.monotonic() > until or (holder is not None and holder.pid == os.getpid()):
                yield False
                return
            time.sleep(0.05)
    try:
        yield True
    finally:
        lock.release()


def listing_problems(files: Store, root: Root) -> tuple[dict[str, str], list[str]]:
    """What the root lists and should not, a sentence for each group; and the groups that it does not list yet."""
    found = found_groups(files, root.listing({}))
    wrong = sorted(name for name, entry in root.listed.items() if found.get(name) != entry)
    groups = {name for name, entry in found.items() if OWN in entry["attributes"]}
    listed = {name for name, entry in root.listed.items() if OWN in entry.get("attributes", {})}
    told = dict.fromkeys(
        next((g for g in sorted(groups | listed) if name == g or name.startswith(f"{g}/")), name) for name in wrong
    )
    inner = [name for name in told if not any(other.startswith(f"{name}/") for other in told)]
    problems = {
        name: f"the root lists {name}, which is {'another now' if name in groups else 'not there'}" for name in inner
    }
    return problems, sorted(groups - listed)
