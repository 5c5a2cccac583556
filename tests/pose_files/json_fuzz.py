"""Breaks OpenPose JSON: its bytes, its values and its structure; the same for the same seed."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

CORPUS = Path(__file__).parent / "corpus"
_ODD: tuple[Any, ...] = (
    None, True, "", "x", -1, 0, 1e300, -1e300, 1e-320, 10**400, [], {}, [[]], {"people": []}, "\ud800", "\0",
    [0] * 1000, float("nan"), float("inf"),
)  # fmt: skip
_TOKENS = (
    b"NaN",
    b"Infinity",
    b"1e999",
    b"-",
    b"[",
    b"]",
    b"{",
    b"}",
    b'"',
    b"\\",
    b"\xff",
    b"\0",
    b",",
    b"9" * 400,
)


def corpus() -> list[bytes]:
    """The saved frames: healthy ones of every version, and those that once did harm elsewhere."""
    return [path.read_bytes() for path in sorted(CORPUS.glob("*.json"))]


def fuzz(frames: list[bytes], seed: str) -> bytes:
    """One broken frame."""
    rng = random.Random(seed)
    data = rng.choice(frames)
    for _ in range(rng.choice((1, 1, 2, 4))):
        data = rng.choice((_cut, _flip, _insert, _repeat, _restructure, _restructure))(data, rng)
    return data[: 1 << 20]


def _cut(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(data) + 1)
    return data[:start] + data[start + rng.choice((0, 1, 10, 1 << 20)) :]


def _flip(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data or b" ")
    for _ in range(rng.choice((1, 3, 20))):
        out[rng.randrange(len(out))] = rng.randrange(256)
    return bytes(out)


def _insert(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice(_TOKENS) * rng.choice((1, 1, 30, 2000)) + data[at:]


def _repeat(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + data[at : at + rng.choice((5, 100, 2000))] * rng.choice((2, 20)) + data[at:]


def _restructure(data: bytes, rng: random.Random) -> bytes:
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError):
        return data
    places = list(_places(tree))
    if not places:
        return json.dumps(rng.choice(_ODD)).encode("utf-8", "replace")
    holder, key = rng.choice(places)
    action = rng.randrange(3)
    if action == 0:
        holder[key] = rng.choice(_ODD)
    elif action == 1:
        del holder[key]
    else:
        other_holder, other_key = rng.choice(places)
        holder[key] = json.loads(json.dumps(other_holder[other_key]))
    return json.dumps(tree).encode("utf-8", "replace")


def _places(node: Any, depth: int = 0) -> Any:
    """(holder, key) of every node below ``node``, the first of each long list."""
    if depth > 20:
        return
    items = node.items() if isinstance(node, dict) else enumerate(node[:40]) if isinstance(node, list) else ()
    for key, child in list(items):
        yield node, key
        yield from _places(child, depth + 1)
