"""A fitted `Recognizer` as a file of arrays: nothing is pickled, and reading it runs no code."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gesture_core.classify.comparison import Comparison
from gesture_core.classify.examples import ExampleLibrary
from gesture_core.classify.known import KnownDistances
from gesture_core.classify.learning import ExampleWeights
from gesture_core.classify.recognizer import Recognizer
from gesture_core.errors import GestureError, InputError
from gesture_core.files import printable, read_arrays, write_arrays
from gesture_core.settings import settings_from_dict
from gesture_core.types import Signals

_FORMAT = 1
_LARGEST = 4 << 30
"""Bytes of such a file, once unpacked."""
_KINDS = "UifbS"
"""Kinds of labels that a file holds: texts, numbers, truth values, bytes."""


def save_recognizer(fitted: Recognizer, path: Path, facts: Mapping[str, Any]) -> None:
    """Write ``fitted`` and ``facts`` about it, plain values, to ``path``.

    Raises
    ------
    InputError
        ``E_LABELS`` where labels are neither texts nor numbers.
    """
    library = fitted.library
    labels = np.asarray(library.labels)
    if labels.dtype.kind not in _KINDS:
        raise InputError(
            f"labels of type {labels.dtype} cannot be saved", remedy="texts or numbers", code="E_LABELS"
        )
    signals = [item for item in library.series if isinstance(item, Signals)]
    arrays = {
        "labels": labels,
        "kept": fitted.kept,
        "lengths": np.array([len(item) for item in library.series]),
        "values": np.concatenate(
            [item.values if isinstance(item, Signals) else item for item in library.series]
        ),
    }
    if signals:
        arrays["times"] = np.concatenate([item.times for item in signals])
        arrays["masks"] = np.array([item.mask for item in signals])
        arrays["present"] = np.array([item.present for item in signals])
    if fitted.thresholds is not None:
        arrays["thresholds"] = fitted.thresholds
    if fitted.weights is not None:
        arrays |= {"scales": fitted.weights.scales, "weights": fitted.weights.weights}
        arrays["sharpness"] = np.array(fitted.weights.sharpness)
    header = {
        "format": _FORMAT,
        "preset": fitted.settings.preset,
        "settings": fitted.settings.as_dict(),
        "names": library.names,
        "sources": [item.source for item in signals],
        "channels": signals[0].channels if signals else (),
        "facts": dict(facts),
    }
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    write_arrays(path, arrays)


def load_recognizer(path: Path, known: KnownDistances | None = None) -> tuple[Recognizer, dict[str, Any]]:
    """What `save_recognizer` wrote: the recognizer, and the facts about it.

    Pairs in ``known`` are not compared again; it learns those that are.

    Raises
    ------
    InputError
        ``E_NOT_FOUND`` where there is no such file, ``E_INPUT`` where it is another one, or damaged.
    """
    arrays = read_arrays(path, _LARGEST)
    try:
        header = json.loads(arrays["header"].astype(np.uint8).tobytes())
        if header["format"] != _FORMAT:
            raise ValueError(f"format {header['format']}, this version reads {_FORMAT}")
        settings = replace(settings_from_dict(header["settings"]), preset=str(header["preset"]))
        cuts = np.cumsum(arrays["lengths"])[:-1]
        values: list[Any] = np.split(arrays["values"], cuts)
        if header["channels"]:
            channels = tuple(map(str, header["channels"]))
            every = (
                values,
                np.split(arrays["times"], cuts),
                arrays["masks"],
                arrays["present"],
                header["sources"],
            )
            values = [Signals(v, t, channels, m, p, s) for v, t, m, p, s in zip(*every, strict=True)]
        library = ExampleLibrary(tuple(values), tuple(arrays["labels"]), tuple(header["names"]))
        weights = None
        if "weights" in arrays:
            weights = ExampleWeights(arrays["scales"], arrays["weights"], float(arrays["sharpness"]))
        comparison = Comparison(library.series, settings, known)
        kept, thresholds, facts = arrays["kept"], arrays.get("thresholds"), dict(header["facts"])
        return Recognizer(settings, library, kept, thresholds, weights, comparison), facts
    except (GestureError, KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError(
            f"holds no fitted classifier of this version: {error}", subject=printable(path), code="E_INPUT"
        ) from error
