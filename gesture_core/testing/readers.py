"""The suite of keypoint readers. Each check takes a reader and a sample, a file or folder that it reads.

>>> import pytest
>>> from gesture_core.testing import READER_CHECKS
>>> @pytest.mark.parametrize("check", READER_CHECKS)
... def test_my_reader(check, tmp_path):
...     sample = tmp_path / "clip.mine"
...     sample.write_text("...")
...     check(MyReader(), sample)

The sample must hold somebody in every sequence. A small one is best: damaged copies of it are read
a hundred times.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gesture_core.errors import GestureError
from gesture_core.plugin.interfaces import KeypointReader
from gesture_core.plugin.reading import ReadOptions
from gesture_core.testing.answers import ask, ask_or_refuse, title
from gesture_core.types import PoseSequence, Recording

_CUTS = (0.0, 0.1, 0.5, 0.9, 0.99)
_DAMAGES = 40
_NOISE = np.random.default_rng(0).bytes(4096)


def check_reader_accepts(reader: KeypointReader, sample: Path) -> None:
    """Takes its own files, and no others."""
    name = type(reader).__name__
    assert isinstance(reader, KeypointReader), f"{name} lacks one of the methods accepts, members and read"
    for _ in range(2):
        answer = ask(reader.accepts, sample)
        assert answer is True, f"{name}.accepts answers {answer!r} for its own {sample.name}, expected True"
    with TemporaryDirectory() as folder:
        for other, content in (("clip.mp4", _NOISE), ("notes.txt", b"wave, then clap\n"), ("empty", b"")):
            path = Path(folder, other)
            path.write_bytes(content)
            answer = ask(reader.accepts, path)
            assert answer is False, f"{name}.accepts answers {answer!r} for {other}, expected False"
        (empty := Path(folder, "folder")).mkdir()
        assert ask(reader.accepts, empty) is False, f"{name}.accepts takes an empty folder"
        _lenient(reader.accepts, Path(folder, sample.name))  # which is not there


def check_reader_members(reader: KeypointReader, sample: Path) -> None:
    """Sequences have names of their own in a stable order; [""] stands for a file that is one sequence."""
    name = type(reader).__name__
    members = ask(reader.members, sample)
    assert isinstance(members, list) and all(isinstance(member, str) for member in members), (
        f"{name}.members returns {members!r}, expected a list of str"
    )
    assert members, f'{name}.members returns no name; [""] stands for a file that is one sequence'
    assert len(set(members)) == len(members), f"{name}.members names one sequence twice: {members}"
    assert ask(reader.members, sample) == members, f"{name}.members answers differently the second time"
    missing = "no sequence of this name"
    found = ask_or_refuse("a member that is not there", reader.read, sample, missing)
    assert found is None, f"{name}.read answers for a member that is not there, expected a KeypointError"


def check_reader_sequences(reader: KeypointReader, sample: Path) -> None:
    """A `PoseSequence` for each person, or a `Recording`, with its source; the same bits each time."""
    name = type(reader).__name__
    before = _bytes(sample)
    for member in ask(reader.members, sample):
        sequences = ask(reader.read, sample, member)
        assert isinstance(sequences, list) and all(
            isinstance(one, PoseSequence | Recording) for one in sequences
        ), f"{name}.read returns {type(sequences).__name__}, expected a list of PoseSequence or Recording"
        assert sequences, f"{name}.read finds nobody in {member or sample.name}"
        for one in sequences:
            assert one.frames_with_pose, f"{name}.read gives a sequence of nobody"
            assert sample.name in one.source, (
                f"{name}.read: source is {one.source!r}, expected the path, as the user named it"
            )
        people = [one.person for one in sequences]
        assert len(set(people)) == len(people), f"{name}.read gives two people one number: {people}"
        again = ask(reader.read, sample, member)
        assert [_arrays(one) for one in again] == [_arrays(one) for one in sequences], (
            f"{name}.read gives other keypoints the second time"
        )
    assert _bytes(sample) == before, f"{name} changes the file that it reads"


def check_reader_rate(reader: KeypointReader, sample: Path) -> None:
    """A reader that takes ``options`` uses their rate where the file has no times, and says so."""
    name = type(reader).__name__
    if not is_dataclass(reader) or "options" not in {option.name for option in fields(reader)}:
        return
    faster = replace(reader, **{"options": ReadOptions(fps=2 * ReadOptions().rate)})
    for member in reader.members(sample):
        for slow, fast in zip(reader.read(sample, member), faster.read(sample, member), strict=True):
            if np.array_equal(slow.times, fast.times):
                continue  # the file has times of its own, or a single frame
            assert np.allclose(slow.times, 2 * fast.times), f"{name}: twice the fps are not half the seconds"
            assert slow.provenance.get("assumed"), (
                f'{name}.read takes a rate for granted and does not say so in provenance["assumed"]'
            )


def check_reader_damage(reader: KeypointReader, sample: Path) -> None:
    """What is cut off, damaged, missing or something else is a KeypointError, never another exception."""
    with TemporaryDirectory() as folder:
        missing = Path(folder, "missing", sample.name)
        _lenient(reader.read, missing)
        _lenient(reader.members, missing)
        for what, path in _damaged(sample, Path(folder)):
            _lenient(reader.accepts, path)
            members = ask_or_refuse(what, reader.members, path)
            for member in members or [""]:
                ask_or_refuse(what, reader.read, path, member)


def _lenient(method: Callable[[Path], object], path: Path) -> None:
    """Call ``method`` with a ``path`` at which it may fail, as long as it says so in the right way."""
    try:
        method(path)
    except (GestureError, OSError):
        return
    except Exception as error:
        raise AssertionError(
            f"{title(method)} raises {type(error).__name__} for a path that it cannot read: {error}; "
            "expected a GestureError or an OSError"
        ) from error


def _damaged(sample: Path, folder: Path) -> Iterator[tuple[str, Path]]:
    """Copies of the sample, each with one of its files damaged, and what was done to it."""
    copy = folder / "copy" / sample.name
    copy.parent.mkdir()
    (shutil.copytree if sample.is_dir() else shutil.copy)(sample, copy)
    files = sorted(path for path in copy.rglob("*") if path.is_file()) if copy.is_dir() else [copy]
    rng = np.random.default_rng(1)
    for file in files[:: max(1, len(files) // 2)]:
        whole = file.read_bytes()
        for share in _CUTS:
            file.write_bytes(whole[: int(share * len(whole))])
            yield f"a file of which {share:.0%} is left", copy
        file.write_bytes(_NOISE)
        yield "a file of random bytes", copy
        for _ in range(_DAMAGES):
            damaged = bytearray(whole)
            for place in rng.integers(0, len(whole), 3):
                damaged[place] = rng.integers(256)
            file.write_bytes(bytes(damaged))
            yield "a damaged file", copy
        file.write_bytes(whole)


def _bytes(path: Path) -> list[bytes]:
    """The content of a file, or of all files in a folder."""
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    return [file.read_bytes() for file in files if file.is_file()]


def _arrays(sequence: PoseSequence | Recording) -> tuple[bytes, bytes, bytes]:
    if isinstance(sequence, Recording):
        return sequence.values.tobytes(), repr(sequence.channels).encode(), sequence.times.tobytes()
    return sequence.keypoints.tobytes(), sequence.scores.tobytes(), sequence.times.tobytes()


READER_CHECKS: tuple[Callable[[KeypointReader, Path], None], ...] = (
    check_reader_accepts,
    check_reader_members,
    check_reader_sequences,
    check_reader_rate,
    check_reader_damage,
)
"""The suite of keypoint readers."""
