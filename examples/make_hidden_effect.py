"""Make the example campaign again: `python examples/make_hidden_effect.py OUT`.

What is hidden is read from `hidden-effect-truth.json`, so that neither this file nor the campaign's folder gives it away.
Plant, excitation, camera and noise follow from the seed; the pictures from them (an H.264 encoder of another version may
write other bytes).
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from rfea_vision.twin import TwinOptions, simulate


def main(out: Path) -> None:
    truth = json.loads(Path(__file__).with_name("hidden-effect-truth.json").read_text(encoding="utf-8"))
    options = TwinOptions(
        hidden=truth["parameters"], seed=truth["seed"], video=True, dark_tube=False, write_truth=False
    )

    def progress(done: int, total: int) -> None:
        print(f"\r{100 * done // total} %", end="", file=sys.stderr)

    simulate(out, options, progress)
    print(file=sys.stderr)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python examples/make_hidden_effect.py OUT")
    main(Path(sys.argv[1]))
