"""Breaks files the way disks, networks and editors do: cut, flipped, overwritten, spliced."""

from __future__ import annotations

import random
from collections.abc import Callable


def truncate(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(1, len(data))]


def flip_bits(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 2, 8, 64))):
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def flip_bytes(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 4, 32))):
        out[rng.randrange(len(out))] = rng.randrange(256)
    return bytes(out)


def flip_header(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 3))):
        out[rng.randrange(min(512, len(out)))] = rng.randrange(256)
    return bytes(out)


def zero_block(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(data))
    length = rng.choice((16, 512, 4096))
    return data[:start] + bytes(min(length, len(data) - start)) + data[start + length :]


def cut_out(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(data))
    return data[:start] + data[start + rng.choice((1, 7, 188, 1024)) :]


def repeat(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(data))
    piece = data[start : start + rng.choice((5, 300, 2048))]
    return data[:start] + piece + data[start:]


def splice(data: bytes, rng: random.Random) -> bytes:
    source, target = rng.randrange(len(data)), rng.randrange(len(data))
    piece = data[source : source + rng.choice((64, 700, 3000))]
    return data[:target] + piece + data[target + len(piece) :]


MUTATIONS: dict[str, Callable[[bytes, random.Random], bytes]] = {
    function.__name__: function
    for function in (truncate, flip_bits, flip_bytes, flip_header, zero_block, cut_out, repeat, splice)
}


def mutate(data: bytes, seed: str) -> tuple[str, bytes]:
    """The name of a mutation and the bytes that it makes of ``data``; the same for the same seed."""
    rng = random.Random(seed)
    name = rng.choice(sorted(MUTATIONS))
    return name, MUTATIONS[name](data, rng)
