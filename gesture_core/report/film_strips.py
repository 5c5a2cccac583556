"""Film strips of an input and of the two examples that it was compared with, at even times."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gesture_core.records import encoded
from gesture_core.report.row_previews import drawing_task
from gesture_core.run.explain import RowExplanation
from gesture_core.run.extract import Listener, people_of
from gesture_core.run.found_again import GONE, look_again
from gesture_core.run.store import keypoint_store
from gesture_core.run.workers.engines import perform_all
from gesture_core.types import Job, PoseSequence, Task

PICTURES = 10
"""Of the longest strip; the others have as many for each second."""


@dataclass(frozen=True, eq=False)
class Strips:
    """What `film_strips` drew, by ``query``, ``nearest`` and ``runner_up``.

    Attributes
    ----------
    pictures : mapping of str to (H, count * H, 3) uint8 array
        Red, green and blue.
    missing : mapping of str to str
        Why there is none.
    """

    pictures: Mapping[str, np.ndarray] = field(default_factory=dict)
    missing: Mapping[str, str] = field(default_factory=dict)


def film_strips(found: RowExplanation, listener: Listener | None = None) -> Strips:
    """Strips of what an explanation shows; keypoints without a video are drawn on plain ground."""
    import cv2

    spans = _spans(found)
    longest = max(end - start for _, start, end in spans.values())
    there = look_again({name: found.seen[name][0] or None for name, *_ in spans.values()}, found.settings)
    items = {item.key: item for item in there.values() if item is not None and item.readable}
    job = Job(found.settings.as_dict(), str(keypoint_store()))
    missing, pictures = dict.fromkeys(spans, GONE), dict[str, np.ndarray]()
    with tempfile.TemporaryDirectory(prefix="gesture-strips-") as folder:
        tasks: list[Task] = []
        asked: list[list[str]] = []
        for item, extracted, people in people_of(list(items.values()), found.settings, listener=listener):
            cuts: dict[str, tuple[object, ...]] = {}
            for which, (name, start, end) in spans.items():
                other = there[name]
                if other is None or other.key != item.key:
                    continue
                person = found.row.person if which == "query" or not people else people[0].person
                if extracted.sha256 != found.seen[name][1]:
                    missing[which] = "has changed since the run"
                elif not any(isinstance(one, PoseSequence) and one.person == person for one in people):
                    missing[which] = "channels have no picture"
                else:
                    count = max(1, int(PICTURES * (end - start) / max(longest, 1e-6) + 1e-6))
                    cuts[which] = (encoded(Path(folder, f"{which}.png")), person, start, end, count)
            if cuts:
                tasks.append(drawing_task(len(tasks), item, extracted.stored, list(cuts.values())))
                asked.append(list(cuts))
        for outcome in perform_all(job, tasks, found.settings.limits, 1):
            for which in asked[outcome.number]:
                missing[which] = outcome.error.cause if outcome.error else "there is no frame to show"
        for which in spans:
            drawn = Path(folder, f"{which}.png")
            picture = cv2.imread(str(drawn)) if drawn.is_file() else None
            if picture is not None:
                pictures[which] = np.ascontiguousarray(picture[..., ::-1])
    return Strips(pictures, {which: why for which, why in missing.items() if which not in pictures})


def _spans(found: RowExplanation) -> dict[str, tuple[str, float, float]]:
    """Name, and first and last second, of what is shown."""
    near, far = found.explanation.nearest, found.explanation.runner_up
    shown = {"query": (found.row.input, near.query.times), "nearest": (near.example, near.signals.times)}
    if far is not None:
        shown["runner_up"] = (far.example, far.signals.times)
    return {which: (name, float(times[0]), float(times[-1])) for which, (name, times) in shown.items()}
