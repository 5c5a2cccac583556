"""Kills a run, as the kernel would, at its n-th write, flush, rename or commit, for every n.

``python kill_points.py SOURCE EXAMPLES FOLDER`` forks a child for each n (before anything has started
a thread), resumes what the child left, and compares the table with that of an undisturbed run. Prints
``<kills> kills`` at the end, or what differs.
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path


def arm(count: int) -> None:
    """Kill this process right before its ``count``-th call that changes what is on the disk."""
    import pyarrow.parquet as pq

    from gesture_core.archive import journal

    left = count

    def counted(function):  # type: ignore[no-untyped-def]
        def call(*arguments, **options):  # type: ignore[no-untyped-def]
            nonlocal left
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            return function(*arguments, **options)

        return call

    os.fsync = counted(os.fsync)
    Path.replace = counted(Path.replace)  # type: ignore[method-assign]
    pq.write_table = counted(pq.write_table)
    transaction = journal._Transaction
    transaction.__enter__ = counted(transaction.__enter__)  # type: ignore[method-assign]
    transaction.__exit__ = counted(transaction.__exit__)  # type: ignore[method-assign]


def run(source: str, examples: str, out: Path) -> None:
    from gesture_core.archive.pipeline import run_archive
    from gesture_core.archive.run import RunRequest, as_strings
    from gesture_core.settings import load_settings

    settings = load_settings("paper", environment={}, classify__kernel="numpy")
    run_archive(RunRequest(as_strings(source), out, settings, as_strings(examples), engine="inline"))


def in_child(action) -> int:  # type: ignore[no-untyped-def]
    """The wait status of a forked child that does ``action``."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            action()
            code = 0
        finally:
            os._exit(code)
    return os.waitpid(child, 0)[1]


def table(out: Path) -> list[object]:
    from gesture_core.archive.journal import open_journal

    with open_journal(out) as journal:
        return list(journal.rows())


def main(source: str, examples: str, folder: Path) -> int:
    import gesture_core.archive.pipeline  # noqa: F401 - loaded once, before the forks

    os.environ["GESTURE_CACHE"] = str(folder / "clean-cache")
    assert in_child(lambda: run(source, examples, folder / "clean")) == 0
    expected = table(folder / "clean")
    kills = 0
    while True:
        out = folder / f"run-{kills}"
        os.environ["GESTURE_CACHE"] = str(folder / f"cache-{kills}")

        def killed(out: Path = out, count: int = kills + 1) -> None:
            arm(count)
            run(source, examples, out)

        status = in_child(killed)
        if status == 0:
            break
        assert os.WIFSIGNALED(status), f"failed at point {kills + 1} instead of being killed"
        kills += 1
        assert in_child(lambda out=out: run(source, examples, out)) == 0, f"no resume after point {kills}"
        if table(out) != expected:
            print(f"another table after point {kills}")
            return 1
    print(f"{kills} kills")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2], Path(sys.argv[3])))
