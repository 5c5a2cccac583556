"""Decodes files in a process of its own, so that a crash of native code is seen and survived.

Run as a script it reads lines ``<reader> <path>`` and prints, for each, one line of JSON before the
next is touched; `decode_all` feeds it and restarts it where it dies or hangs.
"""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Job = tuple[str, Path]


@dataclass(frozen=True)
class Decoded:
    """What became of one job: ``outcome`` is complete, incomplete, a code, crash, hang or untyped."""

    reader: str
    path: Path
    outcome: str
    frames: int = 0
    detail: str = ""
    seconds: float = 0.0


def decode_all(jobs: Sequence[Job], *, limit: float = 20.0, memory: int = 3 << 30) -> Iterator[Decoded]:
    """Decode every job in order; none may take more than ``limit`` seconds or ``memory`` bytes."""
    todo = list(jobs)
    while todo:
        worker = _Worker(memory)
        try:
            while todo:
                reader, path = todo.pop(0)
                started = time.monotonic()
                answer = worker.ask(reader, path, limit)
                spent = time.monotonic() - started
                if isinstance(answer, str):
                    yield Decoded(reader, path, answer, detail=worker.last_words(), seconds=spent)
                    break
                yield Decoded(reader, path, answer["outcome"], answer["frames"], answer["detail"], spent)
        finally:
            worker.stop()


class _Worker:
    def __init__(self, memory: int) -> None:
        self._process = subprocess.Popen(
            [sys.executable, __file__, str(memory)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._lines: queue.Queue[str] = queue.Queue()
        self._errors: list[str] = []
        threading.Thread(target=self._pump, daemon=True).start()
        threading.Thread(target=self._listen, daemon=True).start()
        self._lines.get(timeout=120)  # the first line says that the imports are done

    def ask(self, reader: str, path: Path, limit: float) -> dict[str, Any] | str:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{reader} {path}\n")
            self._process.stdin.flush()
            line = self._lines.get(timeout=limit)
        except queue.Empty:
            return "hang"
        except BrokenPipeError:
            return "crash"
        return json.loads(line) if line else "crash"

    def last_words(self) -> str:
        return f"exit {self._process.poll()}: {''.join(self._errors[-20:])[-2000:]}"

    def stop(self) -> None:
        self._process.kill()
        self._process.wait()

    def _pump(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)
        self._process.wait()
        self._lines.put("")

    def _listen(self) -> None:
        assert self._process.stderr is not None
        self._errors.extend(self._process.stderr)


def _decode(reader: str, path: str) -> dict[str, Any]:
    from gesture_core.errors import MediaError
    from gesture_core.video import open_video

    frames, last = 0, -float("inf")
    try:
        with open_video(path, reader) as video:
            for seconds, frame in video:
                frames += 1
                if not seconds >= last or frame.shape != (video.info.height, video.info.width, 3):
                    return {"outcome": "untyped", "frames": frames, "detail": f"{seconds} after {last}"}
                last = seconds
            report = video.report
    except MediaError as error:
        return {"outcome": error.code, "frames": frames, "detail": error.message}
    except Exception as error:  # noqa: BLE001 - whatever is not typed is what the test looks for
        return {"outcome": "untyped", "frames": frames, "detail": f"{type(error).__name__}: {error}"}
    outcome = "complete" if report.complete else "incomplete"
    return {"outcome": outcome, "frames": frames, "detail": "; ".join(report.notes)}


def _serve(memory: int) -> None:
    import importlib.util
    import resource

    import cv2  # noqa: F401 - import before memory is limited

    if importlib.util.find_spec("av"):
        import av  # noqa: F401
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    print("ready", flush=True)
    for line in sys.stdin:
        reader, _, path = line.rstrip("\n").partition(" ")
        print(json.dumps(_decode(reader, path)), flush=True)


if __name__ == "__main__":
    _serve(int(sys.argv[1]))
