"""What tests share is made once, and everybody gets a copy."""

from __future__ import annotations

import pytest

from tests.once import made_once


def test_what_is_asked_for_twice_is_made_once_and_is_a_copy_each_time(tmp_path_factory):
    asked = []

    def make(folder):
        asked.append(folder)
        if len(asked) == 1:
            raise OSError("not this time")
        return {"file": folder / "file", "values": [1.0]}

    with pytest.raises(OSError, match="not this time"):
        made_once(tmp_path_factory, "example", make)
    first, again = (made_once(tmp_path_factory, "example", make) for _ in range(2))
    assert first == again and len(asked) == 2, "what failed is tried again, what is made is not"
    first["values"].append(2.0)
    assert again["values"] == [1.0] == made_once(tmp_path_factory, "example", make)["values"]
