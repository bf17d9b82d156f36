"""What an object store's client costs: obstore beside s3fs, on blocks as campaigns write them. Prints a table.

python benchmarks/object_store.py        (needs moto's server, obstore and s3fs)
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import os
import statistics
import threading
import time
from collections.abc import Callable
from typing import Any
from urllib.request import Request, urlopen

import numpy as np
from moto.server import ThreadedMotoServer
from zarr.buffer import cpu, default_buffer_prototype
from zarr.storage import FsspecStore, ObjectStore


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--keys", type=int, default=60)
    options = parser.parse_args()
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    endpoint = f"http://{host}:{port}"
    os.environ |= {"AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b", "AWS_REGION": "us-east-1"}
    urlopen(Request(f"{endpoint}/bucket", method="PUT")).close()
    loop = asyncio.new_event_loop()
    threading.Thread(target=loop.run_forever, daemon=True).start()
    clients: dict[str, Callable[[str], Any]] = {
        "obstore": lambda name: ObjectStore(_obstore(f"s3://bucket/{name}", endpoint)),
        "s3fs": lambda name: FsspecStore.from_url(f"s3://bucket/{name}", storage_options={"endpoint_url": endpoint}),
    }
    print("| what | obstore, ms a key | s3fs, ms a key | ratio |\n| --- | ---: | ---: | ---: |")
    rng = np.random.default_rng(1)
    for size in (2_000, 200_000, 5_000_000):
        n = max(options.keys * 200_000 // max(size, 200_000), 5)
        spent: dict[tuple[str, str], list[float]] = {}
        for round_ in range(options.rounds):
            for name, make in clients.items():
                files = make(f"{name}-{size}-{round_}")
                blocks = [cpu.Buffer.from_bytes(rng.bytes(size)) for _ in range(n)]
                began = time.perf_counter()
                for i, block in enumerate(blocks):
                    asyncio.run_coroutine_threadsafe(files.set(f"x/c/{i}/0", block), loop).result()
                written = time.perf_counter()
                for i in range(n):
                    asyncio.run_coroutine_threadsafe(files.get(f"x/c/{i}/0", default_buffer_prototype()), loop).result()
                spent.setdefault(("write", name), []).append((written - began) / n)
                spent.setdefault(("read", name), []).append((time.perf_counter() - written) / n)
        for what in ("write", "read"):
            a, b = (1e3 * statistics.median(spent[what, name]) for name in clients)
            ratio = statistics.median(y / x for x, y in zip(spent[what, "obstore"], spent[what, "s3fs"], strict=True))
            print(f"| {what} {size:,} bytes | {a:.2f} | {b:.2f} | {ratio:.2f} |", flush=True)


def _obstore(url: str, endpoint: str) -> Any:
    from obstore.store import from_url

    return from_url(url, endpoint=endpoint, client_options={"allow_http": True})


if __name__ == "__main__":
    main()
