"""Records of the robot, fetched over a link of their own."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator

from cohelm.link.messages import FromRobot, Piece
from cohelm.station.robot_link import Connect

PIECE_WITHIN = 10.0
"""A robot that sends nothing for so long has given up [s]."""


async def pieces(connect: Connect, name: str) -> AsyncGenerator[bytes]:
    """The bytes of a record; nothing where there is none of that name.

    Raises TimeoutError where nothing comes any more: a download that breaks off is seen as
    broken off.
    """
    loop = asyncio.get_running_loop()
    queue: asyncio.Queue[Piece] = asyncio.Queue()

    def hear(message: FromRobot, stamp: float, age: float) -> None:
        if isinstance(message, Piece) and message.name == name:
            loop.call_soon_threadsafe(queue.put_nowait, message)

    link = connect("a download", hear)
    try:
        link.fetch(name)
        while True:
            piece = await asyncio.wait_for(queue.get(), PIECE_WITHIN)
            if not piece.data:
                return
            yield piece.data
    finally:
        link.close()
