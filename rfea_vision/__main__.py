"""``python -m rfea_vision`` is ``rfea``."""

from rfea_vision.cli import main

if __name__ == "__main__":
    main()
