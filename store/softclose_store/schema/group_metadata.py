"""Owns the metadata of a result group: which files it has, whose metadata it is, and its copy.

The copy lies in the folder of the group's first array, where no Zarr tool looks for members. It says what the group's
own metadata says, but for its own digest, so either gives the other back.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from softclose_store.disk.names import checked_member
from softclose_store.schema import digests
from softclose_store.schema.documents import GroupDocument, checked
from softclose_store.schema.texts import read_json

FILES = "softclose_files"
"""Attribute of a result group: sha256 of every file in it."""
OWN = "softclose_digest"
"""Attribute of a result group: sha256 of its own metadata without this."""
NAME = "softclose_group"
"""Attribute of a result group: its name. Metadata of another group are none of its own."""
COPY_NAME = "group.json"
"""What the copy is called."""
BY_HAND = "by-hand"
"""Where result groups lie that say what a person has changed: what counts hangs on them, and nothing computes them
again."""
BOOKKEEPING = (FILES, OWN, NAME)
"""Attributes that say nothing of the result."""


@dataclass(frozen=True, slots=True)
class GroupMetadata:
    """The metadata of one result group, as they were written."""

    name: str
    """The group."""
    document: dict[str, Any]
    """The whole JSON document."""

    @property
    def attributes(self) -> dict[str, Any]:
        """What was said of the result."""
        return {k: v for k, v in self.document["attributes"].items() if k not in BOOKKEEPING}

    @property
    def files(self) -> dict[str, str]:
        """File, from the group's folder -> sha256."""
        files: dict[str, str] = self.document["attributes"][FILES]
        return files

    @property
    def digest(self) -> str:
        """The digest of the metadata: with those of all files in it."""
        return str(self.document["attributes"][OWN])

    @property
    def keys(self) -> list[str]:
        """Every key of the group, its own metadata first. Raises DamageError for a name that is no file of it."""
        return [f"{self.name}/zarr.json", *(checked_member(self.name, member) for member in self.files)]

    @property
    def copy_member(self) -> str | None:
        """Where the copy lies, from the group's folder; None where there is none (no array; an older version)."""
        return next((member for member in self.files if member.endswith(f"/{COPY_NAME}")), None)

    def copy(self) -> bytes:
        """The bytes of the copy."""
        files = {member: digest for member, digest in self.files.items() if member != self.copy_member}
        return encode(self._with_files(files))

    def _with_files(self, files: Mapping[str, str]) -> dict[str, Any]:
        return {**self.document, "attributes": {**self.document["attributes"], FILES: dict(files)}}

    def with_copy(self, member: str) -> GroupMetadata:
        """The metadata of the same group with a copy at `member`."""
        copy = encode(self.document)
        return GroupMetadata(self.name, self._with_files({**self.files, member: digests.sha256(copy)}))

    def encode(self) -> bytes:
        """The bytes of the group's own metadata."""
        return encode(self.document)


def encode(document: Mapping[str, Any]) -> bytes:
    """The bytes of metadata, with their digest."""
    attributes = {name: value for name, value in document["attributes"].items() if name != OWN}
    whole = {**document, "attributes": attributes}
    attributes[OWN] = digests.sha256(digests.canonical_json(whole).encode())
    return json.dumps(whole, indent=1, sort_keys=True).encode()


def decode(content: bytes | None, name: str) -> GroupMetadata | None:
    """The metadata of group `name`; None where these are no metadata of a result group, damaged, or another group's."""
    try:
        document = read_json(content or b"")
        checked(GroupDocument, document)
        whole = encode(document) == content
    except ValueError:
        return None
    is_own = document["attributes"].get(NAME, name) == name  # 0.1 did not say it
    return GroupMetadata(name, document) if whole and is_own else None


def decode_copy(content: bytes | None, name: str, member: str) -> GroupMetadata | None:
    """The metadata of group `name` from its copy, which lies at `member`; None where that is not the copy's."""
    metadata = decode(content, name)
    return None if metadata is None else metadata.with_copy(member)
