"""One thread reads while another works on what was read."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from queue import Empty, Full, Queue
from threading import Event, Thread
from typing import TypeVar

Item = TypeVar("Item")

LOOK_UP_S = 0.1  # how often a full queue is left to see whether anyone still wants what is in it


@dataclass(frozen=True)
class _Ended:
    """The last thing in the queue: with what error the items ended, if with any."""

    error: BaseException | None = None


def read_ahead(items: Generator[Item, None, None], depth: int) -> Generator[Item, None, None]:
    """The same items in the same order, up to `depth` of them taken from `items` in a thread before they are asked for.

    An error in `items` is raised where it would have been without the thread. Close the generator (``contextlib.closing``)
    where it may be left early: the thread then stops, and `items` is closed, before ``close`` returns.
    """
    queue: Queue[Item | _Ended] = Queue(depth)
    unwanted = Event()

    def put(item: Item | _Ended) -> bool:
        while not unwanted.is_set():
            try:
                queue.put(item, timeout=LOOK_UP_S)
                return True
            except Full:
                continue
        return False

    def read() -> None:
        error: BaseException | None = None
        try:
            for item in items:
                if not put(item):
                    break
        except BaseException as raised:  # whatever it is belongs to the one who asked for the items
            error = raised
        finally:
            items.close()
        put(_Ended(error))

    thread = Thread(target=read, name="read ahead", daemon=True)
    thread.start()
    try:
        while True:
            item = queue.get()
            if isinstance(item, _Ended):
                if item.error is not None:
                    raise item.error
                return
            yield item
    finally:
        unwanted.set()
        _empty(queue)
        thread.join()


def _empty(queue: Queue) -> None:
    """Let a thread that waits for room in the queue go on at once."""
    while True:
        try:
            queue.get_nowait()
        except Empty:
            return
