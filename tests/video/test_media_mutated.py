"""Damaged media, decoded apart: no crash, no hang, and no file that lost frames is called complete.

`benchmarks/soak_media.py` does the same with more files.
"""

from __future__ import annotations

from collections import Counter

import pytest
from clips import make_clips
from decoding import Decoded, decode_all
from mutations import MUTATIONS, mutate

pytest.importorskip("av", reason="clips are made with PyAV")
FILES = 300


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[int, str, Decoded]]:
    """(frames of the healthy clip, mutation, what became of it) for each mutated file and reader."""
    folder = tmp_path_factory.mktemp("mutated")
    clips = make_clips(folder)
    made = []
    for number in range(FILES):
        clip = clips[number % len(clips)]
        kind, data = mutate(clip.data, f"suite:{number}")
        path = folder / f"{number}_{kind}.{clip.container}"
        path.write_bytes(data)
        made.append((clip.frames, kind, path))
    jobs = [(reader, path) for _, _, path in made for reader in ("pyav", "opencv")]
    about = {path: (frames, kind) for frames, kind, path in made}
    return [(*about[done.path], done) for done in decode_all(jobs)]


def test_every_file_comes_back_with_a_typed_outcome(results: list[tuple[int, str, Decoded]]) -> None:
    bad = [done for _, _, done in results if done.outcome in ("crash", "hang", "untyped")]
    assert not bad, bad[:3]
    assert len(results) == 2 * FILES
    assert {kind for _, kind, _ in results} == set(MUTATIONS)


def test_no_file_that_lost_frames_is_called_complete(results: list[tuple[int, str, Decoded]]) -> None:
    wrong = [
        done
        for frames, _, done in results
        if done.reader == "pyav" and done.outcome == "complete" and done.frames < frames
    ]
    assert not wrong, wrong[:3]


def test_the_mutations_do_damage(results: list[tuple[int, str, Decoded]]) -> None:
    """Otherwise the two tests above would prove nothing."""
    counts = Counter(done.outcome for _, _, done in results if done.reader == "pyav")
    assert counts["incomplete"] > FILES // 5
    assert sum(n for outcome, n in counts.items() if outcome.startswith("E_MEDIA_")) > FILES // 10
    assert counts["complete"] > FILES // 10
