"""`write_report`: a run as a folder with a page that opens from disk in any browser, without a network."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gesture_core.errors import ConfigError, InputError
from gesture_core.files import printable, replacing
from gesture_core.report.run_rows import PageRows, read_rows
from gesture_core.run.extract import Listener
from gesture_core.run.results import open_results
from gesture_core.run.review import NONE

INDEX, DATA, CLIPS, DETAILS = "index.html", "data.js", "clips", "details"
CHUNK = 40
"""Rows whose alignments are in one file, which the page loads when one of them is looked at."""
NO_ROWS = "the run has no rows: nothing was finished yet, or its shard has no inputs"
_PAGE = Path(__file__).parent / "page"
"""What every page consists of besides its data."""
_NAMED = 5
_BEGINNING = "window.gestureData="
"""How the data of a page begin."""


@dataclass(frozen=True)
class Report:
    """A page that was written.

    Attributes
    ----------
    page : Path
        What to open.
    rows, previews : int
    missing : mapping
        Why a row has no preview, and of how many.
    labels : tuple of str
        Of the examples.
    notes : tuple of str
        What the page lacks, and what may be wrong with it, in sentences.
    """

    page: Path
    rows: int
    previews: int
    missing: Mapping[str, int]
    labels: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def write_report(
    run: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    labels: str = "",
    label_columns: str = "",
    previews: bool = True,
    workers: int = 0,
    listener: Listener | None = None,
) -> Report:
    """Write a page about a run: `gesture report` as a function.

    Parameters
    ----------
    run : path
        The run folder.
    out : path, optional
        The folder of the page; ``report`` in the run folder by default.
    labels, label_columns : str
        What the inputs really are, where that is known, as in `evaluate_archive`.
    previews : bool
        With a small looping video of each row, and of the examples it is compared with.
    workers : int
        Worker processes; 0 for one for each core.
    listener : Listener, optional
        Told about the work as it goes on.

    Raises
    ------
    RunFolderError
        ``E_NO_RUN`` where the folder holds no run.
    ConfigError
        ``E_LABELS`` where ``labels`` do not fit; ``E_OUT`` where ``out`` cannot be written.
    InputError
        ``E_EXISTS`` where ``out`` holds something else.

    Examples
    --------
    >>> from gesture_core.report.run_page import write_report
    >>> report = write_report("run/", "page/")
    >>> report.page.name
    'index.html'
    """
    folder = Path(run, "report") if out is None else Path(out)
    with open_results(run):  # what is no run gets no folder either
        check_page_folder(folder)
    found = read_rows(
        Path(run),
        folder / CLIPS,
        labels,
        label_columns,
        previews=previews,
        workers=workers,
        listener=listener,
    )
    write_page(folder, found)
    known = tuple(found.facts["labels"])
    notes = filter(None, (found.facts["unaligned"], _unknown(found) if known else ""))
    return Report(folder / INDEX, len(found.rows), found.previews, found.missing, known, tuple(notes))


def _unknown(found: PageRows) -> str:
    """Which labels of the truth no example has; empty where all are known, or are of none of the gestures."""
    truth = Counter(row[found.columns.index("truth")] for row in found.rows)
    unknown = sorted(set(truth) - {None, NONE, *found.facts["labels"]})
    rows = sum(truth[label] for label in unknown)
    named = ", ".join(map(printable, unknown[:_NAMED])) + (", …" if len(unknown) > _NAMED else "")
    return f"no example is called {named}: rows of such a name count as wrong ({rows})" if rows else ""


def check_page_folder(folder: Path) -> None:
    """Raise where no page can be written into ``folder``: a file, or a folder of something else."""
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"--out {folder} is a file", remedy="a folder", code="E_OUT")
    if folder.is_dir() and any(folder.iterdir()) and not _is_report(folder):
        raise InputError(
            "holds something else than a report", subject=str(folder), remedy="a new folder", code="E_EXISTS"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        cause = f"--out {folder} cannot be made: {error.strerror or error}"
        raise ConfigError(cause, remedy="another place, or its permissions", code="E_OUT") from None


def _is_report(folder: Path) -> bool:
    """Whether a folder holds a page of ours: others have a file of that name, and clips, as well."""
    if not (folder / DATA).is_file():
        return False
    with (folder / DATA).open("rb") as file:
        return file.read(len(_BEGINNING)) == _BEGINNING.encode()


def write_page(folder: Path, found: PageRows) -> None:
    """Write the page's own files and the data of ``found`` in the place of an earlier page."""
    (folder / DETAILS).mkdir(parents=True, exist_ok=True)
    for old in (folder / DETAILS).glob("*.js"):
        old.unlink()
    aligned = []
    for number, start in enumerate(range(0, len(found.rows), CHUNK)):
        details = found.details[start : start + CHUNK]
        if any(details):
            aligned.append(number)
            script = f"gesture.details({number},{_script(details)});\n"
            (folder / DETAILS / f"{number}.js").write_text(script, "utf-8")
    for asset in sorted(_PAGE.iterdir()):
        (folder / asset.name).write_bytes(asset.read_bytes())
    with replacing(folder / DATA) as temporary:
        data = found.facts | {
            "chunk": CHUNK,
            "details": aligned,
            "columns": found.columns,
            "rows": found.rows,
        }
        temporary.write_text(f"{_BEGINNING}{_script(data)};\n", "utf-8")


def _script(tree: Mapping[str, Any] | Sequence[Any]) -> str:
    """Plain values as an expression of JavaScript: JSON, of which ASCII alone ends no line and no element."""
    return json.dumps(tree, ensure_ascii=True, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
