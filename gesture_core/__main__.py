"""``python -m gesture_core``: the same as ``gesture``."""

from gesture_core.cli import main

if __name__ == "__main__":
    main()
