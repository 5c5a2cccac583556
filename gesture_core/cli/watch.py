"""``gesture watch``: the example gestures in a live source, as they happen."""

from __future__ import annotations

import json
import sys
import time
from contextlib import ExitStack
from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from gesture_core.cli.flags import SEVERAL, UNSAID, SpotFlags
from gesture_core.cli.output import counted, named, say, say_event, warnings_as_lines
from gesture_core.errors import ConfigError, InputError
from gesture_core.files import printable

if TYPE_CHECKING:
    from gesture_core.run.watch import Webhook
    from gesture_core.spot.watch import Seen, WatchSummary

_SECONDS_BETWEEN_LINES = 5.0
_SECONDS_BETWEEN_LOOKS = 0.5
_CLEAR = "\r\x1b[2K"


def watch(
    source: Annotated[str, Parameter(allow_leading_hyphen=True)],
    /,
    *,
    examples: Annotated[tuple[str, ...], SEVERAL],
    labels: str = "folder",
    as_live: Annotated[bool, UNSAID] = False,
    webhook: Annotated[str, UNSAID] = "",
    preview: Annotated[bool, UNSAID] = False,
    flags: SpotFlags | None = None,
    quiet: Annotated[bool, UNSAID] = False,
) -> int:
    """Find the example gestures in a live source as they happen; Ctrl-C ends it.

    Events are lines on a terminal and JSON lines through a pipe. No video is kept.

    Parameters
    ----------
    source
        The number of a camera, an address (rtsp://…, http://…), a video or keypoint file, or - for standard
        input: JPEG pictures one after the other, or for each frame a line of JSON with time and keypoints.
    examples
        As in gesture spot.
    labels
        As in gesture spot.
    as_live
        Play a file at its own speed, as if it came from a camera.
    webhook
        Post each event as JSON to this address.
    preview
        Show what is seen on a page of this machine, whose address is printed.
    quiet
        Events alone.
    """
    from gesture_core.cli.progress import progress
    from gesture_core.run.watch import Watching, Webhook
    from gesture_core.spot.sources import ADDRESSES, Camera
    from gesture_core.spot.watch import Seen

    if not examples:
        raise ConfigError("--examples needs a value", remedy="--examples FOLDER", code="E_OPTION")
    settings = (flags or SpotFlags()).settings()
    with ExitStack() as open_things:
        show = _Screen(quiet)
        hook = open_things.enter_context(Webhook(webhook, show.note)) if webhook else None
        on_frame = None
        if preview:
            from gesture_core.report.preview import Preview

            page = open_things.enter_context(Preview())
            on_frame = page.show
            say(f"preview: {page.address}")
        named_source = Camera(source).name if source.lower().startswith(ADDRESSES) else source
        with progress([named_source], examples, quiet=quiet) as listener, warnings_as_lines(events=True):
            watching = open_things.enter_context(
                Watching(source, examples, settings, labels, as_live, listener, on_frame)
            )
        show.note(f"{watching.name}: watching for {named(watching.gestures)}; Ctrl-C ends it")
        begun = True
        try:
            for found in watching:
                if isinstance(found, Seen):
                    show.event(found, hook)
                elif found:
                    show.note(found.text)
                show.status(watching.summary)
        except KeyboardInterrupt:
            pass  # the way in which watching ends
        except InputError:
            begun = watching.summary.frames > 0
            raise
        finally:
            for seen in watching.watch.finish():
                show.event(seen, hook)
            if begun:
                show.summary(watching.summary, hook)
    return 0


class _Screen:
    """What is shown: events on standard output, everything else on standard error."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._people = sys.stderr.isatty()
        self._wait = _SECONDS_BETWEEN_LOOKS if self._people else _SECONDS_BETWEEN_LINES
        self._last = time.monotonic()
        self._shown = False

    def event(self, seen: Seen, hook: Webhook | None) -> None:
        """An event: a line for people or a line of JSON, and to the webhook."""
        event = seen.event
        tree = {
            **asdict(event), "late": round(seen.late, 3),
            "at": datetime.now(UTC).isoformat(timespec="milliseconds"),
        }  # fmt: skip
        self._clear()
        if sys.stdout.isatty():
            clock = f"{_clock(event.start)} - {_clock(event.end)}"
            print(printable(f"{clock}  {event.label:<16} {event.score:.2f}   {1000 * seen.late:.0f} ms late"))
        else:
            print(json.dumps(tree, ensure_ascii=False))
        sys.stdout.flush()
        if hook:
            hook.send(tree)

    def note(self, text: str) -> None:
        """Something worth saying about the source."""
        if self._quiet:
            return
        self._clear()
        say(text) if self._people else say_event("note", text=text)

    def status(self, found: WatchSummary) -> None:
        """How it goes on: now and then."""
        now = time.monotonic()
        if self._quiet or now - self._last < self._wait:
            return
        self._last = now
        if self._people:
            text = f"{_clock(found.seconds)}  {_counts(found)}"
            print(f"{_CLEAR}{text}", end="", file=sys.stderr, flush=True)
            self._shown = True
        else:
            say_event("watching", **_facts(found))

    def summary(self, found: WatchSummary, hook: Webhook | None) -> None:
        """The end."""
        if self._quiet:
            return
        self._clear()
        undelivered = hook.undelivered if hook else 0
        if not self._people:
            say_event("done", **_facts(found), undelivered=undelivered)
            return
        rate = found.frames / found.elapsed if found.elapsed else 0.0
        events = counted(found.events, "event")
        say(f"{events} in {found.seconds:.1f} s; {rate:.1f} frames/s; {_counts(found)}")
        if found.events:
            middle, high = (1000 * one for one in found.event_latency)
            say(f"from the end of an event until it was said: {middle:.0f} ms, 95 % within {high:.0f} ms")
        if undelivered:
            say(f"{counted(undelivered, 'event')} not delivered to the webhook")

    def _clear(self) -> None:
        if self._shown:
            print(_CLEAR, end="", file=sys.stderr, flush=True)
            self._shown = False


def _counts(found: WatchSummary) -> str:
    middle, high = (1000 * one for one in found.frame_latency)
    return (
        f"{counted(found.frames, 'frame')}, {found.with_pose} with a pose, {found.dropped} dropped; "
        f"{middle:.0f} ms from capture, 95 % within {high:.0f} ms"
    )


def _facts(found: WatchSummary) -> dict[str, object]:
    facts = asdict(found)
    for name in ("frame_latency", "event_latency"):
        facts[name] = [round(value, 4) for value in facts[name]]
    return facts | {name: round(facts[name], 3) for name in ("seconds", "elapsed")}


def _clock(seconds: float) -> str:
    hours, rest = divmod(seconds, 3600)
    minutes, left = divmod(rest, 60)
    return f"{int(hours):02d}:{int(minutes):02d}:{left:05.2f}"
