"""Events in long recordings: F1 at an overlap of .5 and false alarms a minute, beside a sliding window.

    python benchmarks/spotting.py [--shared SHARED] [--sets NAME …] [--videos FOLDER] [--live] [--set K=V …]

Examples are always clips of other people than the one who is tested. The thresholds come from these
examples alone; with ``--calibrate`` from the recordings of these other people, each with the examples of the
rest of them. With ``--live`` the frames come one by one, and nothing of the future is known. MSRC-12 has
points in time instead of intervals: there F within .333 s is the mean over the gestures.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
from datasets import Item, arguments
from environment import header
from strings import Recording, msrc12, string_sets, utkinect

from gesture_core import Spotter, load_settings
from gesture_core.classify.comparison import Comparison
from gesture_core.classify.learning import calibrated_thresholds
from gesture_core.errors import GestureError
from gesture_core.run.calibrate import OPEN, choose_tolerance
from gesture_core.settings import Settings
from gesture_core.signals.chain import Chain
from gesture_core.spot.candidates import Candidate
from gesture_core.spot.evaluation import Annotation, score_events
from gesture_core.spot.examples import NONE
from gesture_core.spot.explanation import subsequence_path
from gesture_core.spot.signals import spans, stream_chain
from gesture_core.spot.suppression import Suppression
from gesture_core.types import Event, Signals

GOALS = {
    "UT-Kinect continuous": "72 / 1.5",
    "UTD-27 strings": "82 / 1.0",
    "OpenPose strings": "96 / 0.3",
    "MSRC-12": "78",
    "body_gesture strings, videos, _none": "65",
}
_HOP = 0.25
"""Seconds from one window to the next."""
_LENGTHS = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Of the windows, as quantiles of those of the examples."""
_TOGETHER = 256
"""Windows that are compared in one call."""

Method = Callable[[Sequence[Item], Settings, Sequence[Recording]], Iterator[list[Event]]]


def spotted(
    items: Sequence[Item], settings: Settings, recordings: Sequence[Recording]
) -> Iterator[list[Event]]:
    """The events of each recording by `Spotter`."""
    spotter = Spotter(
        [item.pose for item in items],
        [item.label for item in items],
        settings,
        names=[item.name for item in items],
    )
    for recording in recordings:
        yield spotter.spot(recording.pose)


def sliding(
    items: Sequence[Item], settings: Settings, recordings: Sequence[Recording]
) -> Iterator[list[Event]]:
    """The nearest example to windows of five lengths; the nearest windows first, none over another.

    Thresholds are mean and deviation of the distances from the examples of a class to the nearest other one.
    """
    chain = Chain.from_settings(settings)
    series = [chain(item.pose) for item in items]
    comparison = Comparison(series, settings)
    classes, codes = np.unique([item.label for item in items], return_inverse=True)
    every = np.arange(len(items))
    limits = calibrated_thresholds(comparison.distances(series), codes, len(classes), 1.0, every)
    durations = [item.pose.times[-1] - item.pose.times[0] for item in items]
    lengths = np.quantile(durations, _LENGTHS)
    for recording in recordings:
        waiting = Suppression(
            lambda one: one.distance <= limits[one.code], settings.spot.overlap, lambda one: np.inf
        )
        windows: list[tuple[float, float, Signals]] = []
        for span in spans(recording.pose, settings.spot.gap):
            for length in lengths:
                for start in np.arange(span.times[0], span.times[-1] - length, _HOP):
                    first, stop = np.searchsorted(span.times, (start, start + length))
                    try:
                        windows.append(
                            (start, start + length, chain(span.part(slice(int(first), int(stop)))))
                        )
                    except GestureError:  # nobody is seen there, or nothing moves
                        continue
        for begin in range(0, len(windows), _TOGETHER):
            some = windows[begin : begin + _TOGETHER]
            for (start, end, _), row in zip(
                some, comparison.distances([one for *_, one in some]), strict=True
            ):
                best = int(row.argmin())
                if np.isfinite(row[best]):
                    waiting.add(
                        Candidate(start, end, int(codes[best]), float(row[best]), best, float(row[best]))
                    )
        yield [
            Event(
                recording.pose.source, 0, one.start, one.end, str(classes[one.code]),
                1 - one.distance / limits[one.code], one.distance, items[one.example].name,
            )
            for one in waiting.settle(np.inf)
            if classes[one.code] != NONE
        ]  # fmt: skip


def at_points(
    events: Sequence[Event], recording: Recording, items: Mapping[str, Item], points: Mapping[str, float],
    settings: Settings,
) -> Iterator[Event]:  # fmt: skip
    """The events as the moments to which the paths through them carry the action points of their examples."""
    chain = stream_chain(settings)
    for event in events:
        item = items[event.example]
        inside = (recording.pose.times >= event.start - 1e-6) & (recording.pose.times <= event.end + 1e-6)
        frames = np.flatnonzero(inside)
        part, example = (
            chain(recording.pose.part(slice(int(frames[0]), int(frames[-1]) + 1))),
            chain(item.pose),
        )
        # An event may be slower or faster than a path allows: then it is that reading of the example.
        ratio = (event.end - event.start) / (example.times[-1] - example.times[0])
        if not 0.6 < ratio < 1.7:
            example = chain(replace(item.pose, times=item.pose.times * ratio))
        else:
            ratio = 1.0
        path, _ = subsequence_path(part.values.astype(float), example.values.astype(float))
        mark = np.searchsorted(example.times, points[event.example] * ratio)
        place = path[np.abs(path[:, 1] - mark).argmin(), 0]
        yield replace(event, start=float(part.times[place]), end=float(part.times[place]))


def main() -> None:
    """Print a row for each set."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--sets", nargs="*", default=[], help="only those whose names begin so")
    parser.add_argument("--videos", type=Path, help="keypoints of body_gesture, as videos.py leaves them")
    parser.add_argument("--set", nargs="*", default=[], help="settings, as of gesture spot")
    parser.add_argument("--calibrate", action="store_true", help="tolerances by the recordings of others")
    parser.add_argument("--live", action="store_true", help="frame by frame, without a sliding window")
    given = parser.parse_args()
    settings = load_settings(None, [*given.set, *(["spot.live=true"] if given.live else [])])
    header()
    print("| set | events | method | F1 | false alarms / min | recall | overlap | late, s | CPU s | goal |")
    print("|---|---|---|---|---|---|---|---|---|---|", flush=True)
    methods: dict[str, Method] = {} if given.live else {"sliding window": sliding}
    methods["spot"] = spotted
    *continuous, points = msrc12(given.shared)
    sets = {
        "UT-Kinect continuous": utkinect(given.shared),
        **string_sets(given.shared, given.videos),
        "MSRC-12": continuous,
    }
    for name, (recordings, items) in sets.items():
        if given.sets and not name.startswith(tuple(given.sets)):
            continue
        for title, method in methods.items():
            own = points if name == "MSRC-12" else {}
            tolerances: Mapping[str, float] = {}
            if given.calibrate and title == "spot":
                title, tolerances = "spot, calibrated", tolerances_by_others(recordings, items, settings)
            _print_row(name, title, method, recordings, items, own, settings, tolerances)


def tolerances_by_others(
    recordings: Sequence[Recording], items: Sequence[Item], settings: Settings
) -> dict[str, float]:
    """For each person the tolerance that fits the recordings of the others best.

    Each of those is spotted with the examples of the people who are neither in it nor tested.
    """
    opened = replace(settings, spot=replace(settings.spot, tolerance=OPEN))
    subjects = sorted({recording.subject for recording in recordings})
    found: dict[tuple[str, str], list[tuple[Recording, list[Event]]]] = {}
    for one, other in combinations(subjects, 2):
        others = [item for item in items if item.subject not in (one, other)]
        both = [recording for recording in recordings if recording.subject in (one, other)]
        for recording, events in zip(both, spotted(others, opened, both), strict=True):
            tested = other if recording.subject == one else one
            found.setdefault((tested, recording.subject), []).append((recording, events))
    chosen = {}
    for tested in subjects:
        seen = [pair for (own, _), pairs in found.items() if own == tested for pair in pairs]
        marks = [Annotation(one.pose.source, *mark[1:], mark[0]) for one, _ in seen for mark in one.truth]
        seconds = sum(float(one.pose.times[-1] - one.pose.times[0]) for one, _ in seen)
        chosen[tested] = choose_tolerance([event for _, events in seen for event in events], marks, seconds)
    return chosen


def _print_row(
    name: str, title: str, method: Method, recordings: Sequence[Recording], items: Sequence[Item],
    points: Mapping[str, float], settings: Settings, tolerances: Mapping[str, float],
) -> None:  # fmt: skip
    started = time.process_time()
    events: list[Event] = []
    by_name = {item.name: item for item in items}
    for subject in sorted({recording.subject for recording in recordings}):
        own = [recording for recording in recordings if recording.subject == subject]
        others = [item for item in items if item.subject != subject]
        tolerance = tolerances.get(subject, settings.spot.tolerance)
        chosen = replace(settings, spot=replace(settings.spot, tolerance=tolerance))
        for recording, found in zip(own, method(others, chosen, own), strict=True):
            events += at_points(found, recording, by_name, points, settings) if points else found
    marks = [Annotation(one.pose.source, *mark[1:], mark[0]) for one in recordings for mark in one.truth]
    seconds = sum(float(one.pose.times[-1] - one.pose.times[0]) for one in recordings)
    scores = score_events(events, marks, seconds)
    key = 0.0 if points else 0.5
    labels = {mark.label for mark in marks} if points else set()
    each = [
        score_events([e for e in events if e.label == one], [m for m in marks if m.label == one], seconds)
        for one in sorted(labels)
    ]
    f1 = float(np.mean([one.f1[key] for one in each])) if each else scores.f1[key]
    late = "" if scores.lateness is None else f"{scores.lateness:+.2f}"
    print(
        f"| {name} | {scores.annotated} | {title} | {100 * f1:.0f} | {scores.false_alarms:.1f} | "
        f"{100 * scores.recall[key]:.0f} | {100 * scores.jaccard:.0f} | {late} | "
        f"{time.process_time() - started:.0f} | {GOALS.get(name, '')} |",
        flush=True,
    )


if __name__ == "__main__":
    main()
