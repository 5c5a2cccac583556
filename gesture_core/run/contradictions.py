"""Examples that contradict each other: one content under two labels, of which at least one is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gesture_core.run.discovery import Input
from gesture_core.types import Row


def contradictions(examples: Sequence[Input], hashes: Mapping[bytes, str]) -> dict[bytes, Input]:
    """An example of another label with the same content, by the key of each example that has one.

    Either label may be the wrong one, so neither can be used: all of them would be at the same
    distance from every input, and their order alone would decide.

    Parameters
    ----------
    examples : sequence of Input
        With their labels.
    hashes : mapping
        Content hash of each by its key; empty for those that cannot be read.
    """
    alike: dict[tuple[str, str], list[Input]] = {}
    for item in examples:
        if hashes[item.key]:
            alike.setdefault((hashes[item.key], item.member), []).append(item)
    return {
        item.key: other
        for group in alike.values()
        for item in group
        for other in [next((one for one in group if one.label != item.label), None)]
        if other is not None
    }


def contradicting_row(item: Input, other: Input, sha256: str, fingerprint: str) -> Row:
    """The row of an example that is as well an example of another label."""
    return Row(
        item.name,
        sha256,
        status="error",
        code="E_CONTRADICTION",
        message=f"{item.name}: is called {item.label}, and {other.name}, with the same content, "
        f"{other.label}; neither is used; try: only the right one of them",
        fingerprint=fingerprint,
    )
