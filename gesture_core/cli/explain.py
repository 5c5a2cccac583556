"""``gesture explain``: why an input of a run got its label."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter, validators

from gesture_core.cli.flags import UNSAID, Whole
from gesture_core.cli.output import check_file, counted, mirroring_hint, print_table, say, warnings_as_lines
from gesture_core.errors import MissingDependencyError
from gesture_core.files import printable

if TYPE_CHECKING:
    from gesture_core.classify.explanation import Alignment, Explanation
    from gesture_core.records import Row

_EXAMPLES_SHOWN = 6
_CHANNELS_LISTED = 12
_SHOWN = {"query": "the input", "nearest": "the nearest example", "runner_up": "the runner-up"}

Channels = Annotated[Whole, Parameter(validator=validators.Number(gte=1))]


def explain(
    run: Path,
    input: str,
    /,
    *,
    person: Whole = 0,
    event: Annotated[Whole, UNSAID] = 0,
    out: Path | None = None,
    channels: Channels = 3,
) -> int:
    """Show why an input of a run got its label: what was matched, and which channels decided.

    Parameters
    ----------
    run
        The run folder.
    input
        The input as the result names it, or a part of its name that no other one has.
    person
        Which person of the input, where it has several.
    event
        Which event, in a run of gesture spot; the first one by default.
    out
        PNG file of the plot (expl is expl.png); explain-<input>.png in the run folder by default.
    channels
        How many channels to draw; at least twelve are listed.
    """
    from gesture_core.cli.progress import progress
    from gesture_core.report.channel_names import ChannelNames
    from gesture_core.report.explanation import explanation_plot
    from gesture_core.report.film_strips import film_strips
    from gesture_core.run.explain import explain as explain_row

    if out is not None:
        out = out if out.suffix or out.is_dir() else out.with_suffix(".png")
        check_file(out, (".png",))
    with progress([], quiet=not sys.stderr.isatty()) as listener, warnings_as_lines():
        found = explain_row(run, input, person, event, listener=listener)
        target = out or run / found.file_name
        check_file(target, (".png",))
        row, missing = found.row, None
        file, mark, member = row.input.partition("::")
        title = f"{Path(file).name}{mark}{member}: {row.label or row.status}"
        try:  # before anything is printed: a closed pipe must not cost it
            strips = film_strips(found, listener)
            names = ChannelNames(found.settings, spotted=bool(row.event))
            explanation_plot(found.explanation, title, target, names, channels, strips, _facts(row))
        except MissingDependencyError as error:
            missing, strips = error, None
    if sys.stdout.isatty():
        _print(found.row, found.explanation, channels, found.settings.classify.classifier)
    else:
        print(json.dumps(_record(found.row, found.explanation), ensure_ascii=False))
    if found.sided:
        say(mirroring_hint(found.sided))
    if missing and out:
        raise missing
    reasons = strips.missing if strips else {}
    for why in dict.fromkeys(reasons.values()):
        *others, last = (_SHOWN[one] for one in reasons if reasons[one] == why)
        say(f"no pictures of {' and '.join(filter(None, [', '.join(others), last]))}: {why}")
    say(f"no picture: {missing.message}" if missing else str(target))
    return 0


def _facts(row: Row) -> str:
    """What the run says of a row, in one line."""
    numbers = [(name, getattr(row, name)) for name in ("score", "confidence", "margin", "distance")]
    said = [f"{name} {value:.3g}" for name, value in numbers if value is not None]
    return ", ".join(filter(None, [_when(row).removeprefix(", "), row.code, *said]))


def _when(row: Row) -> str:
    """Of an event, its number and its time."""
    return f", event {row.event} from {row.start:.2f} to {row.end:.2f} s" if row.event else ""


def _record(row: Row, found: Explanation) -> dict[str, Any]:
    """The row, what it was compared with and at which cost, and what each example adds, for programs."""
    about = (
        "input", "person", "event", "start", "end", "label", "status", "code", "distance", "margin",
        "confidence", "score",
    )  # fmt: skip
    return {
        **{key: getattr(row, key) for key in about},
        "nearest": _side(found.nearest),
        "runner_up": found.runner_up and _side(found.runner_up),
        "examples": [asdict(one) for one in found.contributions],
        "members": dict(found.members),
        "lead": found.lead,
    }


def _side(side: Alignment) -> dict[str, Any]:
    channels = zip(side.query.channels, side.costs.tolist(), side.used, strict=True)
    return {
        **{key: getattr(side, key) for key in ("example", "label", "distance", "mirrored")},
        "costs": {channel: cost for channel, cost, used in channels if used},
    }


def _print(row: Row, found: Explanation, channels: int, classifier: str) -> None:
    from gesture_core.classify.explanation import contrast

    near, far = found.nearest, found.runner_up
    status = f"{row.status} {row.code}".strip()
    print(printable(f"{row.input}: {row.label or '-'}{_when(row)} ({status})"))
    if row.label not in (None, near.label):
        print(printable(f"  the run gave the label {row.label}, this version gives {near.label}"))
    for which, side in (("answer", near), ("runner-up", far)):
        if side is not None:
            mirror = ", mirrored" if side.mirrored else ""
            text = f"  {which:<10} {side.label:<16} {side.distance:.4g}{mirror}  {side.example}"
            print(printable(text))
    used = near.used if far is None else near.used | far.used
    order = [c for c in contrast(found) if used[c]]
    rows = []
    for channel in order[: max(channels, _CHANNELS_LISTED)]:
        cells = [near.query.channels[channel], f"{near.costs[channel]:.4g}"]
        if far is not None:
            cells += [f"{far.costs[channel]:.4g}", f"{far.costs[channel] - near.costs[channel]:+.4g}"]
        rows.append(cells)
    columns = ["channel", f"cost: {near.label}"]
    if far is not None:
        columns += [f"cost: {far.label}", f"in favour of {near.label}"]
    print_table(columns, rows, right=columns[1:])
    left = len(order) - len(rows)
    what = "costs" if far is None else "differences"
    notes = [f"{counted(left, 'more channel')} with smaller {what}"] if left else []
    idle = len(used) - len(order)
    notes += [f"{counted(idle, 'channel')} not compared"] if idle else []
    print("; ".join([*notes, "costs add up to the distance"]))
    _print_examples(found, classifier)


def _print_examples(found: Explanation, classifier: str) -> None:
    """What each example adds, the largest parts and the sum of the others, and what each member says."""
    far = found.runner_up
    if far is None:
        return
    if not (found.contributions or found.members):
        if found.lead:  # of a classifier that looks at more than the distances
            print(
                f"classifier {classifier!r} decides by what it has learned, not by these distances: "
                f"a lead of {found.lead:.3g}; it does not tell what each channel or example adds"
            )
        return
    favours = f"in favour of {found.nearest.label} over {far.label}"
    largest, rest = found.contributions[:_EXAMPLES_SHOWN], found.contributions[_EXAMPLES_SHOWN:]
    rows = [[v.example, v.label, f"{v.distance:.4g}", f"{v.added:+.3f}"] for v in largest]
    if rest:
        rows.append([counted(len(rest), "more example"), "", "", f"{sum(v.added for v in rest):+.3f}"])
    if rows:
        print_table(["example", "label", "distance", favours], rows, right=["distance", favours])
    if len(found.members) > 1:
        said = ", ".join(f"{name} {added:+.3f}" for name, added in found.members)
        print(f"all examples decide: {said}; together the margin, {found.lead:.3g}")
    else:
        print(f"all examples decide; their contributions add up to the margin, {found.lead:.3g}")
