"""Keypoints of inputs for the commands that look at people, not at rows: with a progress bar."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gesture_core.run.inputs import Input
    from gesture_core.run.workers.keypoints import Extracted
    from gesture_core.settings import Settings
    from gesture_core.types import PoseSequence


def people_of(
    items: Sequence[Input],
    settings: Settings,
    *,
    identity: Mapping[str, Any] | None = None,
    workers: int = 0,
    quiet: bool = False,
) -> Iterator[tuple[Input, Extracted, list[PoseSequence]]]:
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
    (Input, Extracted, list of PoseSequence)
        As they come, in any order. The list is empty where there is an error, or nobody was found.
    """
    from gesture_core.cli.progress import progress
    from gesture_core.run.extract import extract_all
    from gesture_core.run.store import keypoint_store, read_keypoints

    with progress(quiet=quiet) as listener:
        listener.planned(len(items), len(items), 0, "")
        for item, found in extract_all(
            items, settings, identity=identity, workers=workers, on_frames=listener.frames
        ):
            listener.extracted(item.name, found.cached)
            people: list[PoseSequence] = []
            if not found.code:
                people = read_keypoints(keypoint_store() / found.stored, item.name).sequences
            yield item, found, people
