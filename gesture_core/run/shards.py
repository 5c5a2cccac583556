"""An archive in parts, each in a run folder of its own: what a part holds, and one run of all parts."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gesture_core.errors import ConfigError, RunFolderError
from gesture_core.files import replacing
from gesture_core.run.export import take_out
from gesture_core.run.fingerprint import differences
from gesture_core.run.inputs import Input
from gesture_core.run.results import FITTED, Results, open_results, run_folder

_FORM = re.compile(r"(\d+)/(\d+)")
_SHOWN = 5


@dataclass(frozen=True)
class Shard:
    """One of ``count`` parts of an archive; ``number`` counts from 1.

    An input belongs to a part by a hash of its name, so that every machine that finds the same names
    takes its own part, whatever the order, and new inputs move none of the others.
    """

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Shard | None:
        """``3/16``; None for an empty text.

        Raises
        ------
        ConfigError
            ``E_OPTION``.
        """
        found = _FORM.fullmatch(text)
        if text and not (found and 1 <= int(found[1]) <= int(found[2])):
            raise ConfigError(f"--shard {text!r}", remedy="K/N, from 1/N to N/N: 3/16", code="E_OPTION")
        return cls(int(found[1]), int(found[2])) if found else None

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def holds(self, item: Input) -> bool:
        """Whether ``item`` is in this part."""
        digest = hashlib.sha256(item.name.encode("utf-8", "surrogatepass")).digest()
        return int.from_bytes(digest[:8]) % self.count == self.number - 1


@dataclass(frozen=True)
class Merged:
    """What came of `merge_runs`.

    Attributes
    ----------
    out : Path
    counts : mapping
        Number of rows by status.
    missing : tuple of str
        Shards that none of the runs is, such as ``3/16``.
    unfinished : mapping
        Inputs that have rows, and all inputs, of each run that has not ended.
    archives : tuple of str
        Where the runs have not found the same inputs: how many each found.
    """

    out: Path
    counts: Mapping[str, int]
    missing: tuple[str, ...]
    unfinished: Mapping[str, tuple[int, int]]
    archives: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """0 where nothing is missing; of the rows, their own runs have told."""
        return 3 if self.missing or self.unfinished or self.archives else 0


def merge_runs(runs: Sequence[Path], out: Path, *, overwrite: bool = False) -> Merged:
    """Make one run of several, all of it or nothing: `gesture merge` as a function.

    Parameters
    ----------
    runs : sequence of Path
        Run folders, of one command with different shards, or of other sources each.
    out : Path
        The run folder of all of them. It has exactly their rows afterwards.
    overwrite : bool
        Also where rows that are in none of ``runs`` are lost by that.

    Raises
    ------
    ConfigError
        ``E_MERGE`` where two runs were made with other settings, examples, networks or plugins, an input
        or a shard is in two of them, or ``out`` has rows of other inputs.
    RunFolderError
        Where a folder holds no run, or cannot be written.
    """
    if out.resolve() in {run.resolve() for run in runs}:
        raise ConfigError(f"--out {out} is one of the runs", remedy="a folder of its own", code="E_OUT")
    with ExitStack() as stack:
        opened = [stack.enter_context(open_results(run)) for run in runs]
        for results in opened:
            stack.enter_context(results.failures())
        _check_alike(runs, opened)
        _check_shards(runs, opened)
        stack.enter_context(run_folder(out))
        target = stack.enter_context(Results(out, create=True))
        stack.enter_context(target.failures())
        owners = _owners(runs, opened)
        others = [place for key, place in target.places() if key not in owners]
        if others and not overwrite:
            raise ConfigError(
                f"holds rows of {len(others)} inputs that are in none of the runs",
                subject=str(out),
                kept="its rows",
                remedy="all of the runs, another --out, or --overwrite to lose these rows",
                code="E_MERGE",
            )
        _copy_keypoints(runs, opened, out)
        before = set(target.published().values())
        target.take(opened)
        for name in before - set(target.published().values()):
            take_out(out / "keypoints" / name, out / "removed" / name)
        fitted = next((run / FITTED for run in runs if (run / FITTED).is_file()), None)
        if fitted:
            with replacing(out / FITTED) as temporary:
                shutil.copyfile(fitted, temporary)
        return Merged(out, target.counts(), *_lacks(runs, opened))


def _check_alike(runs: Sequence[Path], opened: Sequence[Results]) -> None:
    """Raise where a run was made otherwise than the first one."""
    first = opened[0]
    for run, results in zip(runs, opened, strict=True):
        if results.get("configuration") is None:
            raise RunFolderError(
                "has not begun", subject=str(run), remedy="its run, or to leave it out", code="E_NO_RUN"
            )
        lines = []
        if results.get("fingerprint") != first.get("fingerprint"):
            before, now = (json.loads(one.get("configuration") or "{}") for one in (first, results))
            lines = differences(before, now) or ["inputs of another kind"]
        libraries = {first.get("library"), results.get("library")} - {None}
        if not lines and len(libraries) > 1:
            lines = ["other examples could be used"]
        if lines:
            shown = "\n  ".join(lines[:20]) + (f"\n  … and {len(lines) - 20} more" if lines[20:] else "")
            raise ConfigError(
                "were made with other settings",
                subject=f"{runs[0]} and {run}",
                kept="both runs",
                remedy=f"one of them again, with --overwrite and the settings of the other\n  {shown}",
                code="E_MERGE",
            )


def _check_shards(runs: Sequence[Path], opened: Sequence[Results]) -> None:
    """Raise where two runs are one shard, or shards of different numbers."""
    seen: dict[str, Path] = {}
    for run, results in zip(runs, opened, strict=True):
        shard = _part(results)["shard"]
        if shard and (twin := seen.get(shard)):
            raise ConfigError(
                f"both are shard {shard}", subject=f"{twin} and {run}", remedy="one of them", code="E_MERGE"
            )
        other = next((one for one in seen if one.partition("/")[2] != shard.partition("/")[2]), None)
        if shard and other:
            raise ConfigError(
                f"are shards {other} and {shard}: not parts of one division",
                subject=f"{seen[other]} and {run}",
                remedy="shards of one number",
                code="E_MERGE",
            )
        if shard:
            seen[shard] = run


def _owners(runs: Sequence[Path], opened: Sequence[Results]) -> dict[bytes, Path]:
    """The run of every input; an error where it has two."""
    owners: dict[bytes, Path] = {}
    for run, results in zip(runs, opened, strict=True):
        for key, _ in results.places():
            if (other := owners.setdefault(key, run)) is not run:
                name = next(row.input for one, row in results.keyed_rows() if one == key)
                raise ConfigError(
                    f"{name} is in both",
                    subject=f"{other} and {run}",
                    kept="both runs",
                    remedy="one of them, or the shards of one command",
                    code="E_MERGE",
                )
    return owners


def _copy_keypoints(runs: Sequence[Path], opened: Sequence[Results], out: Path) -> None:
    """Copy the keypoint files of extractions, as far as they are not there yet."""
    origin: dict[str, Path] = {}
    for run, results in zip(runs, opened, strict=True):
        published, done = results.published(), results.with_keypoints()
        needed = {name for key, name in published.items() if key in done}
        for name in set(published.values()):
            if Path(name).is_absolute() or ".." in Path(name).parts:  # the file of another machine says so
                raise RunFolderError(f"names a file {name!r}", subject=str(run), code="E_RUN_DAMAGED")
            if (other := origin.setdefault(name, run)) is not run:
                raise ConfigError(
                    f"both have a keypoint file {name}",
                    subject=f"{other} and {run}",
                    remedy="gesture extract with both sources and --shard",
                    code="E_MERGE",
                )
            source, target = run / "keypoints" / name, out / "keypoints" / name
            if not source.is_file():  # a run that was ended has said that it will be there
                if name not in needed:
                    continue
                raise RunFolderError(
                    f"lacks the keypoint file {name}",
                    subject=str(run),
                    kept="all runs",
                    remedy="its command again, which writes it",
                    code="E_RUN_DAMAGED",
                )
            facts = source.stat()
            if target.is_file() and (target.stat().st_size, target.stat().st_mtime_ns) == (
                facts.st_size, facts.st_mtime_ns,
            ):  # fmt: skip
                continue
            with replacing(target) as temporary:
                shutil.copy2(source, temporary)


def _lacks(
    runs: Sequence[Path], opened: Sequence[Results]
) -> tuple[tuple[str, ...], dict[str, tuple[int, int]], tuple[str, ...]]:
    """Missing shards, runs that have not ended, and archives that differ."""
    parts = [_part(results) for results in opened]
    shards = {part["shard"] for part in parts} - {""}
    counts = {int(shard.partition("/")[2]) for shard in shards}
    every = [f"{number}/{count}" for count in counts for number in range(1, count + 1)]
    done = [results.inputs() for results in opened]
    unfinished = {
        str(run): (have, part["inputs"])
        for run, part, have in zip(runs, parts, done, strict=True)
        if have < part["inputs"]
    }
    named = [(run, part) for run, part in zip(runs, parts, strict=True) if part["shard"]]
    differ = len({part["names"] for _, part in named}) > 1
    archives = tuple(f"{run}: {part['found']} inputs" for run, part in named if differ)
    return tuple(shard for shard in every if shard not in shards), unfinished, archives


def _part(results: Results) -> dict[str, Any]:
    known: dict[str, Any] = json.loads(results.get("part") or "{}")
    return {"shard": "", "inputs": 0, "found": 0, "names": ""} | known
