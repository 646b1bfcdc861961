"""The type checker in a process of its own, for the one test that asks what it found."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

#: Where the workers find what it said, if it was begun before them
_FOUND = "RFEA_TYPES_FOUND"
_LONGEST_SECONDS = 600.0
_COMMAND = [sys.executable, "-m", "basedpyright", "--pythonpath", sys.executable]


@dataclass(frozen=True)
class TypeCheck:
    """A type checker at work."""

    process: subprocess.Popen[bytes]
    folder: Path

    @classmethod
    def begin(cls, root: Path) -> TypeCheck:
        """Check the checkout at `root`; `types_checked` waits for it."""
        folder = Path(tempfile.mkdtemp(prefix="rfea-types-"))
        os.environ[_FOUND] = str(folder)
        # its exit code is written last, by a shell: a worker cannot wait for what is no child of its own
        line = 'out=$1; shift; "$@" >"$out/said" 2>&1; echo $? >"$out/code.part"; mv "$out/code.part" "$out/code"'
        command = ["sh", "-c", line, "sh", str(folder), *_COMMAND]
        return cls(subprocess.Popen(command, cwd=root, start_new_session=True), folder)

    def end(self) -> None:
        """Stop it, and remove what it said."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, 15)
            self.process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)
        os.environ.pop(_FOUND, None)


def types_checked(root: Path) -> tuple[int, str]:
    """Exit code of the type checker and what it said: of the one that was begun, else of one that is run now."""
    if _FOUND not in os.environ:
        done = subprocess.run(_COMMAND, cwd=root, capture_output=True, text=True, timeout=_LONGEST_SECONDS)
        return done.returncode, done.stdout + done.stderr
    folder = Path(os.environ[_FOUND])
    latest = time.monotonic() + _LONGEST_SECONDS
    while not (folder / "code").exists():
        if time.monotonic() > latest:
            raise TimeoutError("the type checker that was begun before the tests has not ended")
        time.sleep(0.2)
    return int((folder / "code").read_text(encoding="utf-8")), (folder / "said").read_text(encoding="utf-8")
