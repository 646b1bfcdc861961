"""Six tubes of the twin, each with another thing hidden, worked on to their reports: `python docs/gallery.py build/site/gallery`.

Each is what a person gets from `rfea simulate` and `rfea improve`; the page that lists them is `rfea batch`'s own.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

#: Name of the campaign and what `rfea simulate` hides in it.
TUBES = {
    "nothing-hidden": (),
    "relaxation": ("maxwell.k1=0.05", "maxwell.T=0.9s"),
    "dry-friction": ("coulomb.tau_c=0.3mN*m",),
    "payload": ("payload.m=1g",),
    "tilted-gravity": ("gravity_tilt.angle=2deg",),
    "kink": ("kink.c=0.4", "kink.at=0.4"),
}


#: Three runs of 3 s: all six take some four minutes of processor time, and show what longer ones do.
SHORT = ("--duration", "3s", "--rate", "120Hz", "--roles", "train,train,validate")


def rfea(*words: str, within: Path) -> None:
    """Run one command, and stop where it fails."""
    subprocess.run([sys.executable, "-m", "rfea_vision", *words], cwd=within, check=True)


def main(target: Path) -> None:
    """Make the campaigns, their reports, and the page that lists them."""
    target.mkdir(parents=True, exist_ok=True)
    for number, (name, hidden) in enumerate(TUBES.items()):
        if not (target / name).exists():
            rfea(
                "simulate",
                name,
                "--seed",
                str(2000 + number),
                *SHORT,
                *(word for one in hidden for word in ("--hidden", one)),
                within=target,
            )
    done = subprocess.run(
        [sys.executable, "-m", "rfea_vision", "batch", *TUBES, "--index", "index.html"], cwd=target, check=False
    )
    if done.returncode:  # what was finished is kept: the same command goes on from there
        sys.exit(done.returncode)
    for name in TUBES:  # a gallery shows reports, and needs no films and no fits
        for folder in ("models", ".stages"):
            shutil.rmtree(target / name / "rfea" / folder, ignore_errors=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
