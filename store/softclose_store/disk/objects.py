"""Owns object stores (S3 and its like) behind a URL, through obstore: credentials, retries, errors, conditional writes.

The service decides between two that write one key in the same instant: `If-None-Match` creates, `If-Match` replaces.
"""

from __future__ import annotations

import os
from collections.abc import AsyncGenerator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from zarr.abc.buffer import Buffer, BufferPrototype
from zarr.abc.store import ByteRequest
from zarr.storage import ObjectStore

from softclose_store.errors import ServiceError, StoreError

if TYPE_CHECKING:
    from typing import Self

SCHEMES = ("s3", "s3a", "gs", "az", "abfs", "abfss")
"""What obstore serves. S3 is what the tests run."""

NO_LIBRARY = "an object store needs obstore: pip install obstore"

RETRIES, RETRY_S = 8, 60.0
"""Requests that a service refuses for a while (500, slow down, timeouts) are made again so often, for so long [s]."""

TIMEOUT_S = 30.0
"""One request [s]."""

_VARIABLES = ("AWS_", "GOOGLE_", "AZURE_")


def is_object_url(url: str) -> bool:
    """Whether a URL names an object store."""
    return url.partition("://")[0] in SCHEMES


@dataclass(frozen=True, slots=True, kw_only=True)
class Version:
    """One state of a key."""

    content: bytes
    """What it holds."""
    tag: str
    """The service's name of this state."""
    modified: datetime
    """When it was written, by the service's clock."""


class ServiceFiles(ObjectStore[Any]):
    """An object store whose failures say what to do, and that writes under conditions."""

    def with_read_only(self, read_only: bool = False) -> Self:
        """The same store with another `read_only`."""
        return type(self)(self.store, read_only=read_only)

    async def get(self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None) -> Buffer | None:
        """Read a key."""
        with _translated(self):
            return await super().get(key, prototype, byte_range)

    async def exists(self, key: str) -> bool:
        """Whether there is a key."""
        with _translated(self):
            return await super().exists(key)

    async def set(self, key: str, value: Buffer) -> None:
        """Replace a key."""
        with _translated(self):
            await super().set(key, value)

    async def delete(self, key: str) -> None:
        """Remove a key; one that is not there is no error."""
        with _translated(self):
            await super().delete(key)

    def list(self) -> AsyncGenerator[str, None]:
        """Every key."""
        return self._translated_list(super().list())

    def list_dir(self, prefix: str) -> AsyncGenerator[str, None]:
        """Keys and folders right below a folder."""
        return self._translated_list(super().list_dir(prefix))

    async def _translated_list(self, keys: AsyncGenerator[str, None]) -> AsyncGenerator[str, None]:
        with _translated(self):
            async for key in keys:
                yield key

    async def version(self, key: str) -> Version | None:
        """A key with its state's name; None where there is none."""
        import obstore

        with _translated(self):
            try:
                found = await obstore.get_async(self.store, key)
            except FileNotFoundError:
                return None
            content = bytes(await found.bytes_async())
            return Version(content=content, tag=str(found.meta["e_tag"]), modified=found.meta["last_modified"])

    async def create(self, key: str, content: bytes) -> bool:
        """Write a key where there is none; False where there is one."""
        return await self._put(key, content, "create")

    async def replace(self, key: str, content: bytes, tag: str) -> bool:
        """Write a key where it is still in the state `tag`; False where it is not."""
        return await self._put(key, content, {"e_tag": tag})

    async def _put(self, key: str, content: bytes, mode: Any) -> bool:
        import obstore
        from obstore.exceptions import AlreadyExistsError, NotFoundError, NotSupportedError, PreconditionError

        with _translated(self):
            try:
                await obstore.put_async(self.store, key, content, mode=mode)
            except (AlreadyExistsError, PreconditionError):
                return False
            except (NotFoundError, FileNotFoundError):
                if mode == "create":  # the bucket itself is not there
                    raise
                return False
            except NotSupportedError as e:
                raise StoreError(
                    f"{self.store} has no conditional writes, by which one of two drivers wins: use a service that has "
                    "(S3, MinIO, Ceph from Tentacle on, …), or a local path"
                ) from e
            return True


@contextmanager
def _translated(files: ServiceFiles) -> Iterator[None]:
    """The service's refusals as our own errors: bad input, or something that passes."""
    from obstore.exceptions import BaseError, PermissionDeniedError, UnauthenticatedError

    try:
        yield
    except (PermissionDeniedError, UnauthenticatedError) as e:
        raise StoreError(
            f"{files.store} refuses this user: give credentials by the usual variables (AWS_ACCESS_KEY_ID, …) "
            f"({_short(e)})"
        ) from e
    except FileNotFoundError as e:
        raise StoreError(f"{files.store} is not there: make the bucket first ({_short(e)})") from e
    except BaseError as e:
        raise ServiceError(f"{files.store} does not answer as it should, {RETRIES} tries long: {_short(e)}") from e


def _short(e: BaseException) -> str:
    text = " ".join(str(e).partition("Debug source")[0].split())
    return text if len(text) < 400 else text[:400] + " …"


def open_objects(url: str, *, read_only: bool) -> ServiceFiles:
    """The store behind a URL. Raises StoreError where it cannot be."""
    environment = tuple(sorted((k, v) for k, v in os.environ.items() if k.startswith(_VARIABLES)))
    return ServiceFiles(_client(url, environment, os.getpid()), read_only=read_only)


@lru_cache(maxsize=32)
def _client(url: str, environment: tuple[tuple[str, str], ...], process: int) -> Any:
    """One client, with its connections, for each URL, its credentials, and process."""
    try:
        from obstore.exceptions import BaseError
        from obstore.store import from_url
    except ImportError as e:
        raise StoreError(NO_LIBRARY) from e
    given = dict(environment)
    endpoint = given.get("AWS_ENDPOINT_URL_S3") or given.get("AWS_ENDPOINT_URL") or given.get("AWS_ENDPOINT") or ""
    options: dict[str, Any] = {"timeout": timedelta(seconds=TIMEOUT_S)}
    if endpoint.startswith("http://"):  # whoever names one means it
        options["allow_http"] = True
    retry = {"max_retries": RETRIES, "retry_timeout": timedelta(seconds=RETRY_S)}
    config = {"endpoint": endpoint} if endpoint and url.startswith("s3") else None
    settings: dict[str, Any] = {"config": config, "client_options": options, "retry_config": retry}
    try:
        return from_url(url, **settings)
    except (BaseError, ValueError, TypeError) as e:
        raise StoreError(f"cannot open {url}: {_short(e)}") from e
