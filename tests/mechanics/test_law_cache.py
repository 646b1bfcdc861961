"""What is kept of laws in a person's cache folder does not grow without end."""

import os

from rfea_vision.dynamics import compilation


def test_what_was_used_longest_ago_goes(tmp_path, monkeypatch):
    monkeypatch.setattr(compilation, "MOST_BYTES", 2000)
    (tmp_path / "__pycache__").mkdir()
    for age, name in enumerate(("law_new.py", "__pycache__/law_old.nbc", "law_older.py", "__pycache__/law_oldest.nbc")):
        (tmp_path / name).write_bytes(bytes(900))
        os.utime(tmp_path / name, (1e9 - age, 1e9 - age))
    os.utime(tmp_path / "law_older.py", (2e9, 1e9))  # written long ago, and used today
    compilation._derive((), tmp_path / "law_just_made.py")
    left = {path.name for path in tmp_path.rglob("*.*")}
    assert {"law_new.py", "law_older.py", "law_just_made.py"} <= left
    assert not {"law_old.nbc", "law_oldest.nbc"} & left
