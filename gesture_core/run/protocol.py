"""What an evaluation tests: labelled inputs, who performs them, and whether a protocol fits them."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gesture_core.classify.evaluation import folds
from gesture_core.errors import ConfigError
from gesture_core.run.inputs import Input, discover_readable
from gesture_core.run.labels import halves_a_word, label_inputs, search_name
from gesture_core.settings import Settings

_NAMED = 5
"""Labels that a message lists."""


def labelled_inputs(
    sources: Sequence[str], labels: str, columns: str, avoid: Path | None, settings: Settings
) -> list[Input]:
    """The inputs with their labels; those that cannot be read are among them and count as wrong."""
    found = discover_readable(sources, avoid=avoid, settings=settings)
    labelled = label_inputs(found, labels, sources, columns)
    for item in labelled:
        if not item.label or item.code == "E_NOT_FOUND":  # a pattern is no clip that could be wrong
            raise item.error()
    if len({item.label for item in labelled}) == 1:
        raise ConfigError(
            f"every input is called {labelled[0].label!r}: there is nothing to tell apart",
            remedy="inputs of several labels, or other --labels",
            code="E_LABELS",
        )
    return labelled


def subject_of(item: Input, pattern: str, *, explicit: bool) -> str:
    """Who performs ``item``; empty where nothing says how to tell."""
    if not explicit and "(?P<subject>" not in pattern:
        return ""
    try:
        match = search_name(re.compile(pattern), item)
    except re.error as error:
        raise ConfigError(f"--subjects {pattern!r} is no regular expression: {error}") from None
    who = match and match.re.groups and (match.groupdict().get("subject") or match.group(1))
    if not match or not who:
        raise ConfigError(
            f"no subject for {item.name} by {pattern!r}",
            remedy="--subjects with a group, such as '_s(?P<subject>[0-9]+)_' "
            "(one with a / is searched in the whole path)",
            code="E_SUBJECTS",
        )
    if halves_a_word(match, "subject"):
        raise ConfigError(
            f"--subjects {pattern!r} finds {who!r} inside a word of {item.name}",
            remedy="an expression for letters with accents too, such as '_(?P<subject>.+?)_'",
            code="E_SUBJECTS",
        )
    return str(who)


def examples_of_split(items: Sequence[Input], train: str, protocol: str) -> list[bool] | None:
    """Which inputs are the examples of a split."""
    if not train:
        return None
    if protocol != "split":
        raise ConfigError(
            f"--train {train!r} is for a split only", remedy="--protocol split", code="E_OPTION"
        )
    try:
        return [search_name(re.compile(train), item) is not None for item in items]
    except re.error as error:
        raise ConfigError(f"--train {train!r} is no regular expression: {error}", code="E_OPTION") from None


def check_protocol(
    protocol: str,
    items: Sequence[Input],
    who: Sequence[str],
    examples: Sequence[bool] | None,
    neighbors: int,
) -> None:
    """Raise what the protocol would raise, before hours of extraction instead of after them.

    Warns as well of tests that must fail, since no other subject, or nothing else, has their label.
    """
    names, codes = np.unique([str(item.label) for item in items], return_inverse=True)
    alike = np.broadcast_to(0.0, (len(items), len(items)))
    tests, least, impossible = 0, len(items), Counter[str]()
    for fold in folds(protocol, codes, who, alike, examples):
        tests += len(fold.test)
        least = min(least, len(fold.train))
        impossible.update(names[codes[fold.test][~np.isin(codes[fold.test], codes[fold.train])]].tolist())
    if neighbors > least:
        raise ConfigError(
            f"{neighbors} neighbours were asked for, and a fold has {least} example{'s' * (least != 1)}",
            remedy=f"--neighbors up to {least}, or 0 for all examples",
            code="E_NEIGHBORS",
        )
    if impossible:
        _warn(
            f"{impossible.total()} of {tests} test{'s' * (tests != 1)} cannot be right: "
            f"no example of {_some(sorted(impossible))} is left to compare with"
        )


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=4)


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:_NAMED]) + (", …" if names[_NAMED:] else "")
