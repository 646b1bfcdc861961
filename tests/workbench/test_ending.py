"""The workbench ends when it is told to, whatever it still compiles."""

import subprocess
import sys

SCRIPT = """
import threading
from rfea_vision.cli import main
from rfea_vision.workbench import serve

def interrupted(*_, **__):
    threading.Thread(target=threading.Event().wait).start()  # compiles for ever
    raise KeyboardInterrupt

serve.serve = interrupted
main(["open", "anywhere", "--no-browser"])
"""


def test_what_still_compiles_does_not_keep_it_from_ending():
    done = subprocess.run([sys.executable, "-c", SCRIPT], timeout=300, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
