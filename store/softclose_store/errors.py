"""Owns the errors of a store: each says what was got, what is allowed and what to do."""

from __future__ import annotations


class StoreError(ValueError):
    """Anything that a store refuses. The command line turns it into exit code 2."""


class LayoutError(StoreError):
    """A layout that cannot be stored, or arrays that do not fit the store's layout."""


class StoreMissingError(StoreError):
    """There is no campaign at the path: nothing, something else, or a creation that never finished."""


class StoreExistsError(StoreError):
    """The path holds something already."""


class OtherConfigurationError(StoreExistsError):
    """The store at the path holds a campaign of another configuration."""


class OtherAlgorithmError(OtherConfigurationError):
    """The store at the path was begun with another version of the algorithms."""


class SchemaError(StoreError):
    """The store has a schema version that this version of the program does not read."""


class LockedError(StoreError):
    """Another driver holds the store."""


class RecordError(StoreError):
    """A proposal or a record with unknown, missing or ill-shaped fields, or out of order."""


class DamageError(StoreError):
    """Stored bytes are not what was written."""


class NotPlainError(DamageError):
    """Something else than a plain file of bounded size lies where a file of a store should be."""


class ServiceError(OSError):
    """An object store that does not answer: nothing committed is lost, and it may answer later."""
