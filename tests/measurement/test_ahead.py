"""Reading ahead in a thread changes nothing but the time it takes."""

import threading
from contextlib import closing

import pytest

from rfea_vision.readers.ahead import read_ahead


def threads() -> int:
    return sum(thread.name == "read ahead" for thread in threading.enumerate())


def counted(upto, closed, error=None):
    try:
        yield from range(upto)
        if error is not None:
            raise error
    finally:
        closed.append(threading.current_thread().name)


@pytest.mark.parametrize("depth", [1, 3, 100])
def test_the_same_items_in_the_same_order(depth):
    closed = []
    assert list(read_ahead(counted(50, closed), depth)) == list(range(50))
    assert closed == ["read ahead"] and threads() == 0


def test_an_error_comes_after_what_came_before_it_and_keeps_its_words():
    seen = []
    with pytest.raises(OSError, match="the disk is gone"):
        for item in read_ahead(counted(5, [], OSError("the disk is gone")), 2):
            seen.append(item)
    assert seen == [0, 1, 2, 3, 4] and threads() == 0


@pytest.mark.parametrize("leave", [StopIteration, KeyboardInterrupt])
def test_leaving_early_stops_the_thread_and_closes_the_source(leave):
    closed = []
    with pytest.raises((RuntimeError, leave)), closing(read_ahead(counted(10**9, closed), 2)) as items:
        for item in items:
            if item == 3:
                raise leave
    assert closed == ["read ahead"] and threads() == 0


def test_no_more_than_asked_for_is_read_ahead():
    taken = []

    def watched():
        for item in range(100):
            taken.append(item)
            yield item

    with closing(read_ahead(watched(), 4)) as items:
        assert next(items) == 0
        threading.Event().wait(0.05)
        assert len(taken) <= 6  # the one given, four that wait, and one that waits for room
