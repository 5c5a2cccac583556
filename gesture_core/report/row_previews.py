"""Previews of the rows of a run: which are needed, which are in the cache, and making the others."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gesture_core.files import cache_dir, switched_on, tree_sha256
from gesture_core.records import encoded
from gesture_core.run.inputs import Input
from gesture_core.run.store import keypoint_store, mark_used, prune
from gesture_core.run.workers.engines import perform_all
from gesture_core.run.workers.previews import REVISION, still_of
from gesture_core.settings import Settings
from gesture_core.types import Job, Task
from gesture_core.video.writer import can_write_video

LONGEST = 20.0
"""Seconds of an input that a preview shows."""


@dataclass(frozen=True)
class Preview:
    """A preview of a stretch of an input.

    Attributes
    ----------
    name : str
        Of its file, by the content and the stretch.
    seconds : float
    """

    name: str
    seconds: float


@dataclass
class RowPreviews:
    """The previews that a page needs, asked for with `want` and made with `make`.

    Attributes
    ----------
    settings : Settings
        Of the run.
    folder : Path
        Where the page looks for them.
    """

    settings: Settings
    folder: Path
    _wanted: dict[str, tuple[Input, str, int | None, float, float]] = field(default_factory=dict)

    def want(
        self, item: Input, content: str, stored: str, person: int | None, start: float, end: float
    ) -> Preview:
        """A preview of ``person`` in an input from ``start`` to ``end``; of the whole picture with None.

        ``content`` is the hash of the input, ``stored`` the file of its keypoints in the store.
        """
        end = min(end, start + LONGEST)
        key = tree_sha256([REVISION, content, item.member, stored, person, round(start, 3), round(end, 3)])
        name = f"{key[:24]}.mp4"
        self._wanted[name] = (item, stored, person, start, end)
        return Preview(name, end - start)

    def make(self, workers: int = 0, made: Callable[[str], None] = lambda name: None) -> dict[str, str]:
        """Put all of them into the folder, and take away those of an earlier page.

        Returns
        -------
        dict
            Why a preview is missing, by its name.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        for old in self.folder.glob("*.mp4"):
            if old.name not in self._wanted:
                old.unlink()
                still_of(old).unlink(missing_ok=True)
        tasks: dict[Input, list[str]] = {}
        for name, (item, *_) in self._wanted.items():
            files = _files(_cached(name))
            if switched_on("GESTURE_NO_CACHE") or not all(file.is_file() for file in files):
                tasks.setdefault(item, []).append(name)
            else:
                for file in files:
                    mark_used(file)
                made(name)
        reasons = self._draw(tasks, workers, made)
        for name in self._wanted:
            for source, target in zip(_files(_cached(name)), _files(self.folder / name), strict=True):
                _place(source, target)
        prune(_cache(), self.settings.limits.cache)
        missing = {name for name in self._wanted if not (self.folder / name).is_file()}
        return {name: reasons.get(name, "there is no frame to show") for name in missing}

    def _draw(
        self, inputs: Mapping[Input, list[str]], workers: int, made: Callable[[str], None]
    ) -> dict[str, str]:
        items, reasons = list(inputs), dict[str, str]()
        if not can_write_video():
            return dict.fromkeys(self._wanted, "previews need PyAV: pip install 'gesture-core[video]'")
        job = Job(self.settings.as_dict(), str(keypoint_store()))
        tasks = [self._task(number, item, inputs[item]) for number, item in enumerate(items)]
        for outcome in perform_all(job, tasks, self.settings.limits, workers):
            for name in inputs[items[outcome.number]]:
                made(name)
                if outcome.error:
                    reasons[name] = outcome.error.cause
        return reasons

    def _task(self, number: int, item: Input, names: Iterable[str]) -> Task:
        cuts = []
        for name in names:
            _, stored, *stretch = self._wanted[name]
            cuts.append([encoded(_cached(name)), *stretch, 0])
        return drawing_task(number, item, stored, cuts)


def drawing_task(number: int, item: Input, stored: str, cuts: Sequence[Sequence[object]]) -> Task:
    """Have ``cuts`` of an input drawn; each has the values of a `workers.previews.Cut`, its path encoded."""
    arguments = {
        "path": encoded(item.path),
        "video": item.kind == "video",
        "stored": stored,
        "cuts": cuts,
        "address": item.address,
    }
    return Task(number, "draw_previews", arguments)


def _cache() -> Path:
    return cache_dir() / "previews"


def _cached(name: str) -> Path:
    return _cache() / name[:2] / name


def _files(video: Path) -> tuple[Path, Path]:
    """A preview and its still."""
    return video, still_of(video)


def _place(source: Path, target: Path) -> None:
    """Put a file of the cache into a page: the same bytes on disk where that can be, otherwise a copy."""
    if not source.is_file():
        return
    target.unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:  # another disk, or one without links
        shutil.copyfile(source, target)
