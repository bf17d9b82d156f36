"""A network in between, for tests: passes bytes on late, and now and then, as after a lost packet, much later.

python tests/relay.py LISTEN_PORT TO_PORT DELAY_MS LOSS RETRY_MS
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import sys


async def _pass(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, delay: float, loss: float, retry: float
) -> None:
    """In order, as TCP is: what comes behind a lost packet waits for it."""
    loop = asyncio.get_running_loop()
    due: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()

    async def send() -> None:
        while True:
            at, data = await due.get()
            await asyncio.sleep(max(at - loop.time(), 0.0))
            if not data:
                writer.close()
                return
            writer.write(data)
            await writer.drain()

    sending = asyncio.create_task(send())
    with contextlib.suppress(ConnectionError):
        while data := await reader.read(1448):
            lost = retry if random.random() < loss else 0.0
            due.put_nowait((loop.time() + delay + lost, data))
    due.put_nowait((loop.time() + delay, b""))
    with contextlib.suppress(ConnectionError):
        await sending


async def main(listen: int, to: int, delay_ms: float, loss: float, retry_ms: float) -> None:
    """Relay until killed."""

    async def accepted(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, here = await asyncio.open_connection("127.0.0.1", to)
        how = delay_ms / 1e3, loss, retry_ms / 1e3
        await asyncio.gather(_pass(reader, here, *how), _pass(there, writer, *how))

    async with await asyncio.start_server(accepted, "127.0.0.1", listen) as server:
        await server.serve_forever()


if __name__ == "__main__":
    asyncio.run(main(int(sys.argv[1]), int(sys.argv[2]), *(float(v) for v in sys.argv[3:6])))
