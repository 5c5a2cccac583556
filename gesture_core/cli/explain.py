"""``gesture explain``: why an input of a run got its label."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter, validators

from gesture_core.cli.flags import Whole
from gesture_core.cli.screen import counted, print_table, visible
from gesture_core.cli.targets import check_file
from gesture_core.errors import GestureError, InputError, RunFolderError

# Examples that are listed with what they say.
_VOICES = 6

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from gesture_core.classify.estimator import GestureClassifier
    from gesture_core.classify.explanation import Explanation
    from gesture_core.run.inputs import Input
    from gesture_core.settings import Settings
    from gesture_core.types import PoseSequence, Row, Signals


Channels = Annotated[Whole, Parameter(validator=validators.Number(gte=1))]


def explain(
    run: Path, input: str, /, *, person: Whole = 0, out: Path | None = None, channels: Channels = 4
) -> int:
    """Show why an input of a run got its label: channels, their costs, both warpings.

    Parameters
    ----------
    run
        The run folder.
    input
        The input as the result names it, or a part of its name that no other one has.
    person
        Which person of the input, where it has several.
    out
        PNG file of the plot; explain-<input>.png in the run folder by default.
    channels
        How many channels to draw; at least twelve are listed.
    """
    from gesture_core.classify.explanation import explain as explain_row
    from gesture_core.report.explanation import explanation_plot
    from gesture_core.run.results import open_results

    with open_results(run) as journal:
        rows = list(journal.rows())
        row = _row(rows, input, person)
        configuration = json.loads(journal.get("configuration") or "{}")
        left_out = {failed.input for failed in journal.rows("example")}
    settings = _settings(configuration)
    target = out or run / _plot_name(row, rows)
    check_file(target, (".png",))
    if not configuration.get("examples"):
        raise RunFolderError(
            "holds keypoints only, nothing was classified",
            subject=str(run),
            remedy="a folder that gesture classify wrote",
            code="E_NO_RUN",
        )
    if row.distance is None:
        raise _nothing(row)
    examples = {n: known for n, known in configuration["examples"].items() if n not in left_out}
    hashes = {name: known["sha256"] for name, known in examples.items()} | {row.input: row.sha256}
    people = _keypoints(hashes, settings)
    query = _query(row, people, settings)
    classifier = _classifier(examples, people, settings)
    distances = classifier.distances([query])[0]
    found = explain_row(query, classifier.library_, distances, settings, classifier.weighing_)
    title = f"{Path(row.input).name}: {row.label or row.status}"
    explanation_plot(found, title, target, channels)
    _print(row, found, channels)
    print(target, file=sys.stderr)
    return 0


def _row(rows: list[Row], name: str, person: int) -> Row:
    """The row of the input called ``name``, or the only one whose name ends so, or holds it."""
    names = dict.fromkeys(row.input for row in rows)
    found = (
        [n for n in names if n == name]
        or [n for n in names if n.endswith(name)]
        or [n for n in names if name in n]
    )
    if len(found) != 1:
        some = ", ".join((found or list(names))[:5])
        raise InputError(
            f"{name!r} could be any of {len(found)} inputs" if found else f"no input of the run is {name!r}",
            remedy=f"one of {some}{' …' if len(found or names) > 5 else ''}",
            code="E_NOT_FOUND",
        )
    for row in rows:
        if row.input == found[0] and row.person == person:
            return row
    known = " or ".join(f"--person {row.person}" for row in rows if row.input == found[0])
    raise InputError(f"has no person {person}", subject=found[0], remedy=known, code="E_NOT_FOUND")


def _plot_name(row: Row, rows: Sequence[Row]) -> str:
    """Of the plot: the file's name, with its folders where several files have it, and the person."""
    same = {other.input for other in rows if Path(other.input).name == Path(row.input).name}
    name = Path(row.input).name if len(same) == 1 else row.input.lstrip("./")
    number = f"-{row.person}" if row.person else ""
    safe = re.sub(r"[^\w.-]+", "_", name)
    return f"explain-{safe[-80:]}{number}.png"


def _nothing(row: Row) -> InputError:
    """A row that was never compared explains itself."""
    said = row.message.removeprefix(f"{row.input}: ")
    cause = f"there is nothing to explain, {row.status} {row.code}: {said}"
    return InputError(cause, subject=row.input, code="E_NOT_FOUND")


def _settings(configuration: dict[str, Any]) -> Settings:
    from gesture_core.settings import settings_from_dict

    return settings_from_dict(configuration.get("settings", {}))


def _keypoints(hashes: dict[str, str], settings: Settings) -> dict[str, list[PoseSequence]]:
    """People of each input by its name, from the keypoint store or extracted again.

    ``hashes`` are the content hashes that the run saw; an input that has changed since is an error.
    An input that cannot be read is left out.
    """
    from gesture_core.cli.keypoints import people_of

    items = _inputs(hashes)
    people: dict[str, list[PoseSequence]] = {}
    for item, outcome, found in people_of(items, settings, quiet=not sys.stderr.isatty()):
        name = item.name
        if outcome.sha256 and outcome.sha256 != hashes[name]:
            raise InputError(
                "has changed since the run",
                subject=name,
                remedy="gesture classify --overwrite first",
                code="E_CHANGED",
            )
        if not outcome.code:
            people[name] = found
    return people


def _inputs(names: Iterable[str]) -> list[Input]:
    """The inputs that a run calls so; each container is looked into once."""
    from gesture_core.run.inputs import discover

    wanted = set(names)
    paths = dict.fromkeys(name.partition("::")[0] for name in names)
    try:
        return [item for item in discover(list(paths)) if item.name in wanted]
    except InputError as error:
        raise InputError(
            "is not where the run found it",
            subject=error.subject,
            remedy="gesture explain in the folder in which gesture classify was run, or to put it back",
            code=error.code,
        ) from None


def _query(row: Row, people: Mapping[str, list[PoseSequence]], settings: Settings) -> Signals:
    from gesture_core.signals.chain import Chain

    for pose in people.get(row.input, []):
        if pose.person == row.person:
            return Chain.from_settings(settings)(pose)
    raise _nothing(row)


def _classifier(
    examples: Mapping[str, Any], people: Mapping[str, list[PoseSequence]], settings: Settings
) -> GestureClassifier:
    """The classifier of the run, from its examples' keypoints, in their order."""
    from gesture_core.classify.estimator import GestureClassifier

    classifier = GestureClassifier(settings)
    signals, labels, names = [], [], []
    for name, known in examples.items():
        first = people.get(name, [])[:1]
        try:
            signals += classifier.signals(first)
        except GestureError:
            continue  # the run left it out too, and said so
        labels += [known["label"]] * len(first)
        names += [name] * len(first)
    return classifier.fit(signals, labels, names)


def _print(row: Row, found: Explanation, channels: int) -> None:
    from gesture_core.classify.explanation import contrast

    near, far = found.nearest, found.runner_up
    print(f"{visible(row.input)}: {row.label or '-'} ({row.status}{' ' + row.code if row.code else ''})")
    if row.label not in (None, near.label):
        print(f"  the run said {visible(row.label)}, and this version would say {visible(near.label)}")
    for which, side in (("answer", near), ("runner-up", far)):
        if side is not None:
            mirror = ", mirrored" if side.mirrored else ""
            print(f"  {which:<10} {side.label:<16} {side.distance:.4g}{mirror}  {visible(side.example)}")
    used = near.used if far is None else near.used | far.used
    order = [c for c in contrast(found) if used[c]]
    rows = []
    for channel in order[: max(channels, 12)]:
        cells = [near.query.channels[channel], f"{near.costs[channel]:.4g}"]
        if far is not None:
            cells += [f"{far.costs[channel]:.4g}", f"{far.costs[channel] - near.costs[channel]:+.4g}"]
        rows.append(cells)
    columns = ["channel", f"cost: {near.label}"]
    if far is not None:
        columns += [f"cost: {far.label}", f"speaks for {near.label}"]
    print_table(columns, rows, right=columns[1:])
    left = len(order) - len(rows)
    what = "costs" if far is None else "differences"
    notes = [f"{counted(left, 'more channel')} with smaller {what}"] if left else []
    idle = len(used) - len(order)
    notes += [f"{counted(idle, 'channel')} not compared"] if idle else []
    print("; ".join([*notes, "costs add up to the distance"]))
    _print_voices(found)


def _print_voices(found: Explanation) -> None:
    """What the examples say, where all of them decide: the loudest ones, and the sum of the others."""
    far = found.runner_up
    if not found.voices or far is None:
        return
    speaks = f"speaks for {found.nearest.label} against {far.label}"
    loud, rest = found.voices[:_VOICES], found.voices[_VOICES:]
    rows = [[visible(v.example), v.label, f"{v.distance:.4g}", f"{v.says:+.3f}"] for v in loud]
    if rest:
        rows.append([counted(len(rest), "more example"), "", "", f"{sum(v.says for v in rest):+.3f}"])
    print_table(["example", "label", "distance", speaks], rows, right=["distance", speaks])
    print(f"all examples decide; what they say adds up to the margin, {found.lead:.3g}")
