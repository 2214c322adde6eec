"""Records of the robot, fetched over a link of their own."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncGenerator

from cohelm.link.messages import Piece
from cohelm.station.robot_link import Connect

PIECE_WITHIN = 10.0
"""A robot that sends nothing for so long has given up [s]."""
_POLL = 0.02


async def pieces(connect: Connect, name: str) -> AsyncGenerator[bytes]:
    """The bytes of a record; nothing where there is none of that name.

    Raises TimeoutError where nothing comes any more: a download that breaks off is seen as
    broken off.
    """
    link = await asyncio.to_thread(connect, "a download")
    try:
        link.fetch(name)
        since = time.monotonic()
        while True:
            for news in link.news():
                piece = news.message
                if not isinstance(piece, Piece) or piece.name != name:
                    continue
                if not piece.data:
                    return
                since = time.monotonic()
                yield piece.data
            if time.monotonic() - since > PIECE_WITHIN:
                raise TimeoutError(f"the robot sent no more of {name}")
            await asyncio.sleep(_POLL)
    finally:
        await asyncio.to_thread(link.close)
