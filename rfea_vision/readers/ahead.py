"""One thread reads while another works on what was read."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Event, Thread
from typing import TypeVar

Item = TypeVar("Item")


@dataclass(frozen=True)
class _Ended:
    """The last thing in the queue: with what error the items ended, if with any."""

    error: BaseException | None = None


def read_ahead(items: Generator[Item, None, None], depth: int) -> Generator[Item, None, None]:
    """The same items in the same order, up to `depth` of them taken from `items` in a thread before they are asked for.

    An error in `items` is raised where it would have been without the thread. Close the generator (``contextlib.closing``)
    where it may be left early: the thread then stops, and `items` is closed, before ``close`` returns.
    """
    ready: SimpleQueue[Item | _Ended] = SimpleQueue()
    room: SimpleQueue[None] = SimpleQueue()  # one entry for every item that may still be read
    unwanted = Event()
    for _ in range(depth):
        room.put(None)

    def read() -> None:
        error: BaseException | None = None
        try:
            for item in items:
                room.get()
                if unwanted.is_set():
                    break
                ready.put(item)
        except BaseException as raised:  # whatever it is belongs to the one who asked for the items
            error = raised
        finally:
            items.close()
        ready.put(_Ended(error))

    thread = Thread(target=read, name="read ahead", daemon=True)
    thread.start()
    try:
        while True:
            item = ready.get()
            if isinstance(item, _Ended):
                if item.error is not None:
                    raise item.error
                return
            room.put(None)
            yield item
    finally:
        unwanted.set()
        room.put(None)
        thread.join()
