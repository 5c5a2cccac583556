"""A run: what is asked for, what is told while it goes on, and what comes out."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gesture_core.cores import usable_cores
from gesture_core.paths import cache_dir
from gesture_core.run.journal import open_journal
from gesture_core.run.rows import Row
from gesture_core.settings import Settings


@dataclass(frozen=True)
class RunRequest:
    """What a run is to do.

    Attributes
    ----------
    sources : tuple of str
        Files, folders, globs or manifests.
    out : Path
        The run folder.
    settings : Settings
    examples : tuple of str
        Sources of the examples; empty to extract keypoints only.
    labels : str
        How examples get their labels, see `labels.label_inputs`.
    workers : int
        Worker processes; 0 for one for each core.
    engine : str
        Name of an execution engine.
    retry_errors : bool
        Try inputs again whose row is an error.
    overwrite : bool
        Forget the rows of a run that was made with other settings.
    """

    sources: tuple[str, ...]
    out: Path
    settings: Settings
    examples: tuple[str, ...] = ()
    labels: str = "folder"
    workers: int = 0
    engine: str = "processes"
    retry_errors: bool = False
    overwrite: bool = False


class Listener:
    """Told about a run as it goes on; override what is of interest."""

    def planned(self, inputs: int, waiting: int, examples: int, kernel: str) -> None:
        """The work is known: all inputs, those that still wait, the examples, the kernel."""

    def frames(self, name: str, count: int) -> None:
        """``count`` further frames of an input are done."""

    def extracted(self, name: str, cached: bool) -> None:
        """The keypoints of an input or example are there, or it has failed."""

    def example_failed(self, row: Row) -> None:
        """An example cannot be used."""

    def row(self, row: Row) -> None:
        """A row has been committed."""


@dataclass(frozen=True)
class RunSummary:
    """What came of a run.

    Attributes
    ----------
    out : Path
    counts : mapping
        Number of rows by status, those of earlier runs in the same folder included.
    done_now : int
        Inputs that this run worked on; zero where there was nothing to do.
    failed_examples : tuple of Row
    elapsed : float
        Seconds.
    frames : int
        Frames that were decoded now, not taken from the keypoint store.
    kernel : str
    fingerprint : str
    lost_classes : tuple of str
        Labels of which no example can be used, or whose folder holds none: no input can get them.
    assumed : mapping
        What files do not say and was assumed, such as the frames a second of keypoints without
        times, and of how many inputs and examples that this run looked at.
    classes : mapping
        Number of examples that can be used, by label.
    inputs_among_examples : int
        Inputs whose content or movement is that of an example: they find themselves.
    gone : int
        Inputs of earlier runs that are not there any more; their rows were removed.
    """

    out: Path
    counts: Mapping[str, int]
    done_now: int = 0
    failed_examples: tuple[Row, ...] = field(default_factory=tuple)
    elapsed: float = 0.0
    frames: int = 0
    kernel: str = ""
    fingerprint: str = ""
    lost_classes: tuple[str, ...] = ()
    assumed: Mapping[str, int] = field(default_factory=dict)
    classes: Mapping[str, int] = field(default_factory=dict)
    inputs_among_examples: int = 0
    gone: int = 0

    @property
    def exit_code(self) -> int:
        """0 when every row is whole, 3 where there are errors, degraded rows, or examples that are lost."""
        flawed = self.counts.get("error", 0) + self.counts.get("degraded", 0)
        return 3 if flawed or self.failed_examples or self.lost_classes else 0

    def rows(self) -> list[Row]:
        """All rows of the run folder, ordered by input."""
        with open_journal(self.out) as journal:
            return list(journal.rows())


def default_workers(tasks: int) -> int:
    """One worker for each core that this process may use, and no more than there are tasks."""
    return max(1, min(usable_cores(), tasks))


def threads_for(workers: int) -> int:
    """Threads of each worker, so that all of them together fill the cores once."""
    return max(1, default_workers(1 << 30) // workers)


def keypoint_store() -> Path:
    """Folder of the keypoint store, shared by all runs."""
    return cache_dir() / "keypoints"


def as_strings(sources: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]) -> tuple[str, ...]:
    """One source or several, as a tuple of strings."""
    if isinstance(sources, str | os.PathLike):
        return (os.fspath(sources),)
    return tuple(os.fspath(source) for source in sources)
