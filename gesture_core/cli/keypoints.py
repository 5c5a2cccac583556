"""Keypoints of inputs for the commands that look at people, not at rows: with a progress bar."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gesture_core.run.discovery import Input
    from gesture_core.run.work import Outcome
    from gesture_core.settings import Settings
    from gesture_core.types import PoseSequence


def people_of(
    items: Sequence[Input],
    settings: Settings,
    *,
    identity: Mapping[str, Any] | None = None,
    workers: int = 0,
    quiet: bool = False,
) -> Iterator[tuple[int, Outcome, list[PoseSequence]]]:
    """Everybody in each of ``items``, from the keypoint store or extracted in worker processes.

    Parameters
    ----------
    items : sequence of Input
        Videos and keypoint files.
    settings : Settings
    identity : mapping, optional
        From `fingerprint.pose_identity`; without it, it is found and the model is tried first.
    workers : int
        Worker processes; 0 for one for each core.
    quiet : bool
        No progress.

    Yields
    ------
    (position in ``items``, Outcome, list of PoseSequence)
        As they come, in any order. The list is empty where the outcome has a code, or nobody was found.
    """
    from gesture_core.cli.progress import progress
    from gesture_core.run.extraction import extract_all
    from gesture_core.run.run import keypoint_store
    from gesture_core.run.store import read_keypoints

    with progress(quiet=quiet) as listener:
        listener.planned(len(items), len(items), 0, "")
        for outcome in extract_all(
            items, settings, identity=identity, workers=workers, on_frames=listener.frames
        ):
            name = items[outcome.number].name
            listener.extracted(name, outcome.cached)
            people: list[PoseSequence] = []
            if not outcome.code:
                people = read_keypoints(keypoint_store() / outcome.stored, name).sequences
            yield outcome.number, outcome, people
