"""The folder of a run, held by one process at a time, and its results: ``run.db``.

That SQLite file survives a kill at any moment. Each input's rows are committed in one transaction; what is
committed is never done again.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from inspect import signature
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.errors import ConfigError, RunFolderError
from gesture_core.files import check_local
from gesture_core.records import COLUMNS, INTEGERS, REALS, Row

if TYPE_CHECKING:
    from gesture_core.run.inputs import Input

DATABASE, LOCK = "run.db", "run.lock"
FITTED, DISTANCES = "run.fitted", "run.distances"
"""The fitted examples of a run, and the distances of all pairs that were compared: both may be deleted."""
OWN_FILES = frozenset({DATABASE, f"{DATABASE}-wal", f"{DATABASE}-shm", LOCK, FITTED, DISTANCES})
"""What a run leaves in its folder besides its exports; it may lie among videos or examples."""
_VERSION = 2
_TYPES = dict.fromkeys(INTEGERS, "INTEGER") | dict.fromkeys(REALS, "REAL")
_ADDED: dict[str, Any] = {"note": "", "start": None, "end": None, "box": "", "frames_looked_at": 0} | {
    "event": 0, "score": None, "confidence": None,
}  # fmt: skip
"""Columns that the first files of this format lack, with what stands in them."""
_TABLES = {
    "meta": "key TEXT PRIMARY KEY, value TEXT NOT NULL",
    "content": "key BLOB PRIMARY KEY, stamp TEXT NOT NULL, sha256 TEXT NOT NULL",
    "rows": "key BLOB NOT NULL, place BLOB NOT NULL, role TEXT NOT NULL, "
    + ", ".join(f'"{name}" {_TYPES.get(name, "TEXT")}' for name in COLUMNS)
    + ", PRIMARY KEY (role, key, person, event)",
    "published": "key BLOB PRIMARY KEY, file TEXT NOT NULL",
}

_QUOTED = ", ".join(map("`{}`".format, COLUMNS))
"""The columns as SQL takes them: some are its words."""


class Results:
    """An open ``run.db``. Use as a context manager.

    Parameters
    ----------
    folder : Path
        The run folder.
    create : bool
        Make the file where it is missing, and open it for writing.

    Raises
    ------
    RunFolderError
        Where there is no run, the file is damaged, or it was written by another version.
    """

    def __init__(self, folder: Path, *, create: bool = False) -> None:
        self.path = folder / DATABASE
        self._writable = create
        if not create and not self.path.is_file():
            runs = [str(path.parent) for path in sorted(folder.glob(f"*/{DATABASE}"))[:3]]
            evaluated = (folder / "evaluation.json").is_file()
            raise RunFolderError(
                "holds no run, but what gesture evaluate wrote: confusion.png, rejection.png, answers.csv"
                if evaluated
                else "holds no run",
                subject=str(folder),
                remedy="a folder that gesture classify wrote"
                + (f", such as {', '.join(runs)}" if runs else ""),
                code="E_NO_RUN",
            )
        try:
            self._db = self._open(create)
            version = self.get("version")
        except sqlite3.Error as error:
            raise RunFolderError(
                f"cannot be used: {error}",
                subject=str(self.path),
                remedy="another --out",
                code="E_RUN_DAMAGED",
            ) from error
        if version != str(_VERSION):
            self._db.close()
            raise RunFolderError(
                f"was written in format {version}, this version reads {_VERSION}",
                subject=str(self.path),
                remedy="another --out",
                code="E_RUN_VERSION",
            )

    def _open(self, create: bool) -> sqlite3.Connection:
        if not create:
            frozen = "" if os.access(self.path.parent, os.W_OK) else "&immutable=1"
            address = f"{self.path.absolute().as_uri()}?mode=ro{frozen}"
            db = sqlite3.connect(address, isolation_level=None, timeout=10, uri=True)
            db.row_factory = sqlite3.Row
            return db
        db = sqlite3.connect(self.path, isolation_level=None, timeout=10)
        db.row_factory = sqlite3.Row
        db.execute("PRAGMA journal_mode=WAL")
        db.execute("PRAGMA synchronous=FULL")
        with _transaction(db):
            for name, columns in _TABLES.items():
                db.execute(f"CREATE TABLE IF NOT EXISTS {name} ({columns})")
            db.execute("INSERT OR IGNORE INTO meta VALUES ('version', ?)", (str(_VERSION),))
            known = {row["name"] for row in db.execute("PRAGMA table_info(rows)")}
            if lacking := _ADDED.keys() - known:
                there = "key, place, role, " + ", ".join(f"`{name}`" for name in COLUMNS if name in known)
                added = ", ".join(f"`{name}`" for name in lacking)
                db.execute("ALTER TABLE rows RENAME TO earlier")
                db.execute(f"CREATE TABLE rows ({_TABLES['rows']})")
                db.execute(
                    f"INSERT INTO rows ({there}, {added}) "
                    f"SELECT {there}, {', '.join('?' * len(lacking))} FROM earlier",
                    [_ADDED[name] for name in lacking],
                )
                db.execute("DROP TABLE earlier")
        return db

    def __enter__(self) -> Results:
        return self

    def __exit__(self, *_: object) -> None:
        if self._writable:
            # One file that can be copied as it is; while somebody reads it, it stays as it was.
            with suppress(sqlite3.Error):
                self._db.execute("PRAGMA busy_timeout=0")
                self._db.execute("PRAGMA journal_mode=DELETE")
        self._db.close()

    @contextmanager
    def failures(self) -> Iterator[None]:
        """SQLite errors inside the block as a RunFolderError: a full disk, a lost mount."""
        try:
            yield
        except sqlite3.Error as error:
            raise RunFolderError(
                f"cannot be read or written: {error}",
                subject=str(self.path),
                kept="every committed row",
                remedy="free space there, then the same command again",
                code="E_RUN_WRITE",
            ) from error

    def get(self, key: str) -> str | None:
        """A fact about the run."""
        row = self._db.execute("SELECT value FROM meta WHERE key = ?", (key,)).fetchone()
        return row["value"] if row else None

    @property
    def configuration(self) -> dict[str, Any]:
        """What decided its rows, from `fingerprint.run_configuration`; empty where no run has begun."""
        return dict(json.loads(self.get("configuration") or "{}"))

    def set(self, facts: Mapping[str, Any]) -> None:
        """Record facts about the run: strings as they are, anything else as JSON."""
        with _transaction(self._db):
            for key, value in facts.items():
                text = value if isinstance(value, str) else json.dumps(value, sort_keys=True)
                self._db.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, text))

    def sha256(self, item: Input) -> str | None:
        """The content hash of an input that has not been written since, None where it has."""
        query = "SELECT sha256 FROM content WHERE key = ? AND stamp = ?"
        row = self._db.execute(query, (item.key, item.stamp)).fetchone()
        return row["sha256"] if row else None

    def remember(self, item: Input, sha256: str) -> None:
        """Record the content hash of an input, so that it need not be read again."""
        values = (item.key, item.stamp, sha256)
        self._db.execute("INSERT OR REPLACE INTO content VALUES (?, ?, ?)", values)

    def commit(self, item: Input, rows: Sequence[Row], *, role: str = "query") -> None:
        """Replace the rows of one input, in one transaction with what identifies its content."""
        with _transaction(self._db):
            self._db.execute("DELETE FROM rows WHERE role = ? AND key = ?", (role, item.key))
            self.remember(item, rows[0].sha256)
            for row in rows:
                record = row.as_record()
                self._db.execute(
                    f"INSERT INTO rows (key, place, role, {_QUOTED}) "
                    f"VALUES (?, ?, ?, {', '.join('?' * len(COLUMNS))})",
                    (item.key, item.place, role, *itemgetter(*COLUMNS)(record)),
                )

    def done(self, *, retry_errors: bool = False) -> Iterator[tuple[bytes, str]]:
        """Keys and stamps of inputs that need no more work while they have these stamps."""
        having = "HAVING SUM(status = 'error') = 0" if retry_errors else ""
        query = (
            "SELECT rows.key, stamp FROM rows JOIN content USING (key) "
            f"WHERE role = 'query' AND rows.sha256 = content.sha256 GROUP BY rows.key {having}"
        )
        return map(tuple, self._db.execute(query))

    def rows(self, role: str = "query") -> Iterator[Row]:
        """All rows, ordered by input, person and event."""
        for _, row in self.keyed_rows(role):
            yield row

    def keyed_rows(self, role: str = "query") -> Iterator[tuple[bytes, Row]]:
        """All rows, ordered as by `rows`, each with the key of its input."""
        query = "SELECT * FROM rows WHERE role = ? ORDER BY input, key, person, rowid"
        for record in self._db.execute(query, (role,)):
            yield record["key"], Row.from_record(_ADDED | dict(record))

    def place_of(self, name: str) -> Path | None:
        """The absolute path of the input called ``name``."""
        query = "SELECT place FROM rows WHERE role = 'query' AND input = ?"
        row = self._db.execute(query, (name,)).fetchone()
        return Path(os.fsdecode(row["place"])) if row else None

    def places(self) -> Iterator[tuple[bytes, bytes]]:
        """Key and path of every input that has rows."""
        query = "SELECT DISTINCT key, place FROM rows WHERE role = 'query'"
        return map(tuple, self._db.execute(query))

    def inputs(self) -> int:
        """Number of inputs that have rows."""
        query = "SELECT COUNT(DISTINCT key) AS n FROM rows WHERE role = 'query'"
        return int(self._db.execute(query).fetchone()["n"])

    def take(self, others: Sequence[Results]) -> None:
        """Have exactly the rows of other runs, with all that belongs to them, in one transaction."""
        with _transaction(self._db):
            for table in ("rows", "content", "published"):
                self._db.execute(f"DELETE FROM {table}")
            for other in others:
                for table in _TABLES:
                    names = [row["name"] for row in self._db.execute(f"PRAGMA table_info({table})")]
                    records = other._db.execute(f"SELECT * FROM {table} ORDER BY rowid")
                    self._db.executemany(
                        f"INSERT OR REPLACE INTO {table} ({', '.join(f'`{name}`' for name in names)}) "
                        f"VALUES ({', '.join('?' * len(names))})",
                        (
                            tuple(known[name] for name in names)
                            for record in records
                            for known in [_ADDED | dict(record)]
                        ),
                    )
            self._db.execute("DELETE FROM meta WHERE key = 'part'")

    def forget(self, keys: Sequence[bytes], *, role: str = "query") -> None:
        """Delete the rows of inputs."""
        with _transaction(self._db):
            for key in keys:
                self._db.execute("DELETE FROM rows WHERE role = ? AND key = ?", (role, key))

    def copies(self, hashes: Collection[str]) -> int:
        """Number of inputs with one of these content hashes, or at no distance from an example."""
        query = "SELECT sha256, MIN(distance) AS nearest FROM rows WHERE role = 'query' GROUP BY key"
        return sum(row["sha256"] in hashes or row["nearest"] == 0 for row in self._db.execute(query))

    def with_keypoints(self) -> frozenset[bytes]:
        """Keys of the inputs in which somebody was found."""
        query = "SELECT DISTINCT key FROM rows WHERE role = 'query' AND frames_with_pose > 0"
        return frozenset(row["key"] for row in self._db.execute(query))

    def published(self) -> dict[bytes, str]:
        """The keypoint file that belongs to each input that has one, by the input's key."""
        return {row["key"]: row["file"] for row in self._db.execute("SELECT key, file FROM published")}

    def publish(self, key: bytes, file: str) -> None:
        """Record that ``file`` is about to belong to an input."""
        self._db.execute("INSERT OR REPLACE INTO published VALUES (?, ?)", (key, file))

    def retract(self, keys: Sequence[bytes]) -> None:
        """Record that the keypoint files of inputs are gone."""
        with _transaction(self._db):
            self._db.executemany("DELETE FROM published WHERE key = ?", [(key,) for key in keys])

    def counts(self, role: str = "query") -> dict[str, int]:
        """Number of rows by status."""
        query = "SELECT status, COUNT(*) AS n FROM rows WHERE role = ? GROUP BY status"
        return dict(map(tuple, self._db.execute(query, (role,))))

    def clear(self) -> None:
        """Forget all rows; content hashes stay."""
        with _transaction(self._db):
            self._db.execute("DELETE FROM rows")


@contextmanager
def _transaction(db: sqlite3.Connection) -> Iterator[None]:
    """Committed where the block ends without an error, otherwise rolled back."""
    db.execute("BEGIN IMMEDIATE")
    try:
        yield
    except BaseException:
        db.execute("ROLLBACK")
        raise
    db.execute("COMMIT")


def open_results(folder: str | os.PathLike[str]) -> Results:
    """The results of an existing run folder."""
    return Results(Path(folder))


@contextmanager
def run_lock(folder: Path) -> Iterator[None]:
    """Hold ``folder`` for this process.

    Raises
    ------
    RunFolderError
        ``E_RUN_LOCKED`` where another living process holds it.
    """
    from filelock import FileLock, Timeout

    # Where the system cannot lock, a soft lock would go by the number of a process, which may be another
    # one's by now; earlier versions have no such fallback.
    known = signature(FileLock.__init__).parameters
    hard: dict[str, Any] = {"fallback_to_soft": False} if "fallback_to_soft" in known else {}
    lock = FileLock(folder / LOCK, blocking=False, **hard)
    try:
        lock.acquire()
    except NotImplementedError as error:
        raise RunFolderError(
            f"cannot be locked: {error}", subject=str(folder), remedy="--out on another file system"
        ) from error
    except PermissionError as error:
        raise RunFolderError(
            f"cannot be written: {error.strerror}",
            subject=str(folder),
            remedy="its permissions, or another --out",
            code="E_RUN_WRITE",
        ) from error
    except Timeout:
        raise RunFolderError(
            "another run holds this folder",
            subject=str(folder),
            remedy="wait for it, or another --out",
            code="E_RUN_LOCKED",
        ) from None
    try:
        yield
    finally:
        lock.release()


@contextmanager
def run_folder(folder: Path) -> Iterator[None]:
    """Make ``folder`` where there is none, and hold it for this process.

    One that was made here, and in which no run began before an error came (a mistyped source, a wrong
    setting), is removed: mistakes leave nothing behind.

    Raises
    ------
    ConfigError
        ``E_OUT`` where it is a file or cannot be made.
    RunFolderError
        Where another process holds it, or it cannot be held.
    """
    check_local(folder, f"--out {folder}")
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise ConfigError(f"--out {folder} is a file", remedy="a folder", code="E_OUT") from None
    except OSError as error:
        cause = f"--out {folder} cannot be made: {error.strerror or error}"
        raise ConfigError(cause, remedy="another place, or its permissions", code="E_OUT") from None
    try:
        with run_lock(folder):
            yield
    except BaseException:
        if made and not _has_begun(folder):
            with suppress(OSError):  # somebody put something else into it
                for name in OWN_FILES:
                    (folder / name).unlink(missing_ok=True)
                folder.rmdir()
        raise


def _has_begun(folder: Path) -> bool:
    try:
        with open_results(folder) as found:
            return bool(found.configuration)
    except sqlite3.Error:
        return True
    except RunFolderError as error:
        return error.code != "E_NO_RUN"
