"""Events in long recordings: F1 at an overlap of .5, false alarms a minute, recall, lateness.

    python benchmarks/spotting.py [--shared SHARED] [--sets NAME …] [--live] [--set KEY=VALUE …]

Examples are always clips of other people than the one who is tested. The thresholds come from these
examples alone. With ``--live`` the frames come one by one, and nothing of the future is known.
"""

from __future__ import annotations

import time

from datasets import arguments
from environment import header
from strings import string_sets, utkinect

from gesture_core import Spotter, load_settings
from gesture_core.spot.evaluation import Annotation, score_events
from gesture_core.types import Event


def main() -> None:
    """Print a row for each set."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--sets", nargs="*", default=[], help="only those whose names begin so")
    parser.add_argument("--set", nargs="*", default=[], help="settings, as of gesture spot")
    parser.add_argument("--live", action="store_true", help="frame by frame")
    given = parser.parse_args()
    settings = load_settings(None, given.set)
    header()
    print("| set | events | F1 at .5 | false alarms / min | recall | overlap | late, s | CPU s |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    sets = {"UT-Kinect continuous": utkinect(given.shared), **string_sets(given.shared)}
    for name, (recordings, items) in sets.items():
        if given.sets and not name.startswith(tuple(given.sets)):
            continue
        started = time.process_time()
        events: list[Event] = []
        marks: list[Annotation] = []
        seconds = 0.0
        for subject in sorted({recording.subject for recording in recordings}):
            others = [item for item in items if item.subject != subject]
            spotter = Spotter(
                [item.pose for item in others],
                [item.label for item in others],
                settings,
                names=[item.name for item in others],
                live=given.live,
            )
            for recording in (one for one in recordings if one.subject == subject):
                pose = recording.pose
                events += spotter.push(pose) + spotter.finish() if given.live else spotter.spot(pose)
                marks += [Annotation(pose.source, start, end, label) for label, start, end in recording.truth]
                seconds += float(pose.times[-1] - pose.times[0])
        scores = score_events(events, marks, seconds)
        late = "" if scores.lateness is None else f"{scores.lateness:+.2f}"
        print(
            f"| {name} | {scores.annotated} | {100 * scores.f1[0.5]:.0f} | {scores.false_alarms:.1f} | "
            f"{100 * scores.recall[0.5]:.0f} | {100 * scores.jaccard:.0f} | {late} | "
            f"{time.process_time() - started:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
