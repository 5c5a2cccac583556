"""``python -m gesture_core``, and where ``gesture`` begins."""

import sys


def main() -> None:
    """Run the command line; an interrupt while it is still being loaded ends it quietly, too."""
    try:
        from gesture_core.cli import main as run
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
