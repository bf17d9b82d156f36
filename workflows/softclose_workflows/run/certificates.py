"""Owns certificates of a cluster of one's own: one key for scheduler, workers and clients, and Dask's settings."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from softclose.tables import at_home
from softclose_workflows.errors import ExecutorError

CERTIFICATE, KEY, SETTINGS = "certificate.pem", "key.pem", "dask.yaml"

_SETTINGS = """\
# Whoever has the key beside this file runs code on the cluster. Written by `softclose tls`.
distributed:
  comm:
    require-encryption: true
    tls:
      ca-file: {certificate}
      scheduler: {{cert: {certificate}, key: {key}}}
      worker: {{cert: {certificate}, key: {key}}}
      client: {{cert: {certificate}, key: {key}}}
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificates:
    """Where they are."""

    folder: Path
    """Readable by its owner alone: certificate.pem, key.pem and dask.yaml."""


def make_certificates(folder: str | Path) -> Certificates:
    """Write a new certificate and key, and Dask's settings, into a new folder. Raises ExecutorError where there is one.

    The certificate signs itself, and is its own authority: who holds the key is in, and nobody else.
    """
    from distributed import Security

    where = at_home(folder).absolute()
    if (where / KEY).exists():
        raise ExecutorError(f"{where} holds a key already; keep it, or name another folder")
    store = next((place for place in (where, *where.parents) if (place / "zarr.json").exists()), None)
    if store is not None:
        raise ExecutorError(
            f"{store} is a campaign's store, which keys do not belong in; name a new folder for them, or certify its "
            f"candidates: softclose certify {store}"
        )
    if where.exists() and not (where.is_dir() and not any(where.iterdir())):
        raise ExecutorError(f"{where} is there and not an empty folder; name a new one, which you alone will read")
    try:
        where.mkdir(mode=0o700, parents=True, exist_ok=True)
        where.chmod(0o700)
    except OSError as e:
        raise ExecutorError(f"cannot write into {where}: {e}") from e
    made = Security.temporary()
    settings = _SETTINGS.format(certificate=where / CERTIFICATE, key=where / KEY)
    for name, text in ((CERTIFICATE, made.tls_ca_file), (KEY, made.tls_client_key), (SETTINGS, settings)):
        descriptor = os.open(where / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(str(text))
    return Certificates(folder=where)
