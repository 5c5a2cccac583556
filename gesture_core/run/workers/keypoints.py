"""One input to keypoints in the store."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.errors import GestureError, InputError, KeypointError, PluginError, RunFolderError
from gesture_core.files import content_sha256, stamp, switched_on, tree_sha256
from gesture_core.plugin.abilities import ExplainsRefusal
from gesture_core.plugin.registry import calling, registry
from gesture_core.records import decoded
from gesture_core.run.addresses import drop, fetch, look, place_for, sha256_of
from gesture_core.run.store import Extracted, Stored, mark_used, read_keypoints, storing, write_keypoints
from gesture_core.types import PoseSequence, Recording

if TYPE_CHECKING:
    import numpy as np

    from gesture_core.plugin.interfaces import KeypointReader, PoseBackend, Video
    from gesture_core.pose.parts import Parts
    from gesture_core.run.workers.worker import Worker
    from gesture_core.video.reader import Picture

Answer = bool | tuple[str, str]
"""Whether a reader takes a file; or the code and the cause of its failure to say so."""
_REPORT_SECONDS = 0.5
_LONG = 1000
"""Frames up to which a video that was interrupted is begun again."""
_OFTEN = 1 / 3
"""Share of the frames from which other people are worth a note."""
_OTHERS = (
    "other people are visible in a third of the frames or more; the one who is seen best is taken "
    "(--set pose.people=multi takes all)"
)


class KeypointExtractor:
    """Keypoints of inputs, as functions of the table; the first video opens the pose network."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._job = worker.job
        self._settings = worker.settings
        self._hashed: tuple[Path, str, str] = (Path(), "", "")
        self._readers: dict[str, KeypointReader] = {}

    def try_model(self) -> None:
        """Run the pose network on a known picture; a GestureError says what is wrong with its answer."""
        from gesture_core.pose.extract import try_backend

        try_backend(self.backend, self._settings.pose.people)

    def lasts(self, path: str) -> float | None:
        """Seconds of a video by what its container says, None where it does not."""
        from gesture_core.video import open_configured

        with open_configured(decoded(path), self._settings) as video:
            info = video.info
        return info.frames_declared / info.fps if info.frames_declared and info.fps else None

    def accepts(self, reader: str, paths: Sequence[str]) -> list[Answer]:
        """For each path whether the reader takes it, or what went wrong."""
        answers: list[Answer] = []
        entry = registry().find("reader", reader)
        for path in paths:
            try:
                with calling(entry, passing=(OSError,)):
                    answers.append(bool(self.reader(reader).accepts(decoded(path))))
            except GestureError as error:
                answers.append((error.code, error.cause))
            except OSError as error:
                answers.append(("E_READ", f"{entry} cannot read it: {error.strerror or error}"))
            self._worker.alive()
        return answers

    def refusal(self, reader: str, path: str) -> str:
        """Why a reader does not take a file; empty where it does not say."""
        with calling(registry().find("reader", reader), passing=(OSError,)):
            opened = self.reader(reader)
            return str(opened.refusal(decoded(path))) if isinstance(opened, ExplainsRefusal) else ""

    def members(self, reader: str, path: str) -> list[str]:
        """Names of the sequences in a file or folder, one at least."""
        entry = registry().find("reader", reader)
        with calling(entry):
            found = list(self.reader(reader).members(decoded(path)))
        if not found or not all(isinstance(member, str) for member in found):
            cause = f"{entry} says that its members are {str(found)[:80]}"
            raise PluginError(cause, code="E_PLUGIN_CONTRACT")
        return found

    def extract(self, path: str, member: str, reader: str, address: str = "") -> dict[str, Any]:
        """Keypoints of one input into the store: the fields of `Extracted`.

        ``reader`` names its keypoint reader, and is empty for a video. With an ``address`` it is fetched,
        unless its keypoints are there, and deleted afterwards. An error of the input becomes its code
        and message, as the hash that was found is worth keeping.

        Raises
        ------
        RunFolderError
            ``E_STORE_WRITE``, after which no other input can succeed either.
        """
        return asdict(self._extracted(decoded(path), member, reader, address))

    def _extracted(self, path: Path, member: str, reader: str, address: str) -> Extracted:
        found = Extracted(complete=False)
        try:
            entry = look(address) if address else None
            found = replace(found, stamp=entry.stamp if entry else stamp(path))
            key = tree_sha256([self._job.keys[f"reader {reader}" if reader else "video"], member])
            if entry and (sha256 := sha256_of(entry)):  # nothing need be fetched
                known = replace(found, sha256=sha256)
                if stored := self._from_store(_stored_name(sha256, key), known):
                    return stored
            if entry:
                path = place_for(address, path)
                fetch(entry, path, self._worker.alive)
            if self._hashed[:2] != (path, found.stamp):  # once for all sequences in one file
                sha256 = content_sha256(path, self._worker.alive)
                self._hashed = (path, found.stamp, sha256)
            found = replace(found, sha256=self._hashed[2])
            name = _stored_name(found.sha256, key)
            return self._from_store(name, found) or self._fresh(path, member, reader, name, found, address)
        except OSError as error:
            cause = f"cannot be read: {error.strerror or error}"
            return found.failed(InputError(cause, remedy="check its permissions", code="E_READ"))
        except GestureError as error:
            if isinstance(error, RunFolderError) or error.code == "E_WORKER_MEMORY":
                raise  # the first is everybody's, the second is tried again
            return found.failed(error)
        finally:
            if address and not member:  # of a file of several, the others' turn comes
                drop(path)

    def _from_store(self, name: str, found: Extracted) -> Extracted | None:
        path = Path(self._job.store) / name
        if switched_on("GESTURE_NO_CACHE") or not path.is_file():
            return None
        try:
            stored = read_keypoints(path)
        except KeypointError:  # damaged on disk: extract again, which replaces the file
            return None
        mark_used(path)
        return found.holding(stored, name, cached=True)

    def _fresh(
        self, path: Path, member: str, reader: str, name: str, found: Extracted, address: str
    ) -> Extracted:
        if reader:
            sequences, facts = self._from_reader(path, member, reader)
        else:
            sequences, facts = self._from_video(path, Path(self._job.store) / name)
        sequences = [sequence for sequence in sequences if sequence.frames_with_pose]
        if not address and stamp(path) != found.stamp:
            raise InputError("was written while it was read", remedy="--retry-errors", code="E_CHANGED")
        with storing(self._job.store):
            write_keypoints(Path(self._job.store) / name, sequences, facts)
        return found.holding(Stored(sequences, facts), name)

    def _from_video(self, path: Path, stored: Path) -> tuple[list[PoseSequence], dict[str, Any]]:
        backend, settings = self.backend, self._settings
        self._worker.alive()
        from gesture_core.pose.extract import extract_poses
        from gesture_core.video import open_configured

        with open_configured(path, settings) as video:
            frames = _Looked(video, settings.pose.rate, self._worker.report)
            entry = registry().find("pose", settings.pose.backend)
            with _journal(backend, video, stored) as asked, calling(entry, passing=(OSError,)):
                sequences = extract_poses(
                    frames,
                    asked,
                    settings.pose.people,
                    follow=settings.pose.follow,
                    parts=self.parts,
                    source=str(path),
                )
            report = video.report
        if settings.keypoints.depth:
            sequences = [sequence.solid for sequence in sequences]
        others = sum(int(sequence.provenance.get("others", 0)) for sequence in sequences)
        frames.flush()
        return sequences, {
            "frames_declared": None if report.frames_declared is None else int(report.frames_declared),
            "frames_read": int(report.frames_read),
            "frames_looked_at": frames.count,
            "complete": bool(report.complete),
            "notes": [
                *map(str, report.notes),
                *([_OTHERS] if others >= max(1, frames.count * _OFTEN) else []),
                *([frames.coarse] if frames.repeated >= max(1, report.frames_read * _OFTEN) else []),
            ],
            "seconds": frames.seconds,
            "assumed": str(report.assumed),
        }

    def _from_reader(self, path: Path, member: str, name: str) -> tuple[list[Any], dict[str, Any]]:
        from gesture_core.pose.plausible import check_plausible

        pose, known = self._settings.pose, {}
        sequences: list[Any]  # PoseSequence, or one Recording
        odd: list[str] = []
        if name == "store":
            stored = read_keypoints(path)
            sequences, known = stored.sequences, dict(stored.facts)
        else:
            reader = self.reader(name)
            entry = registry().find("reader", name)
            with calling(entry, passing=(OSError,)):
                sequences = [_checked(one, channels=entry.channels) for one in reader.read(path, member)]
        if sequences and isinstance(sequences[0], Recording):
            return sequences[:1], known | self._facts_of(sequences)
        if pose.score is not None:
            sequences = [_above(sequence, pose.score) for sequence in sequences]
        if name != "store":
            stated = self._settings.keypoints.axes is not None
            odd = [note for one in sequences for note in check_plausible(one.flat, axes_stated=stated)]
        if pose.people == "single" and len(sequences) > 1:
            best = max(sequences, key=lambda s: (float(s.scores.sum()), -s.person))
            sequences = [replace(best, person=0)]
        if len({sequence.person for sequence in sequences}) < len(sequences):
            # Rows and files tell people apart by their numbers.
            sequences = [replace(sequence, person=n) for n, sequence in enumerate(sequences)]
        return sequences, self._facts_of(sequences, odd) | known

    def _facts_of(self, sequences: list[Any], odd: Sequence[str] = ()) -> dict[str, Any]:
        frames = max((len(sequence) for sequence in sequences), default=0)
        if frames > self._settings.limits.frames:
            raise KeypointError(
                f"holds {frames} frames, at most {self._settings.limits.frames}",
                remedy="a larger --set limits.frames=…",
                code="E_KEYPOINTS_LIMIT",
            )
        seconds = max((float(s.times[-1] - s.times[0]) for s in sequences if len(s)), default=0.0)
        lost = sorted({s.provenance["lost"] for s in sequences if "lost" in s.provenance})
        unread = max((int(s.provenance.get("lost_frames", 0)) for s in sequences), default=0)
        return {
            "frames_declared": None,
            "frames_read": frames - unread,
            "frames_looked_at": frames - unread,
            "complete": not lost,
            "notes": list(dict.fromkeys([*lost, *(note for one in sequences for note in _notes(one)), *odd])),
            "seconds": seconds,
            "assumed": str(sequences[0].provenance.get("assumed", "")) if sequences else "",
        }

    def reader(self, name: str) -> KeypointReader:
        """A keypoint reader with what the settings say of its files, constructed once."""
        if name not in self._readers:
            offered = {"options": self._settings.keypoints, "people": self._settings.pose.people}
            taken = {key: one for key, one in offered.items() if registry().takes("reader", name, key)}
            self._readers[name] = registry().make(
                "reader", name, self._settings.options.get(name, {}), **taken
            )
        return self._readers[name]

    @cached_property
    def parts(self) -> Parts | None:
        """What finds hands and faces, where the settings ask for them."""
        if not {"hands", "face"} & {*self._settings.keypoints.parts}:
            return None
        from gesture_core.pose.parts import open_parts

        return open_parts(self._settings, self.backend.skeleton, self._job.threads)

    @cached_property
    def backend(self) -> PoseBackend:
        """The pose backend of the settings, its network loaded, and what decoding needs, too."""
        self._worker.slow()
        from gesture_core.pose.extract import open_backend
        from gesture_core.video import reader_name

        reader = reader_name(self._settings.pose.reader, self._settings.options)
        for module in ("cv2", *registry().find("video", reader).needs):
            import_module(module)  # now, so that the first video does not seem to stand still
        return open_backend(self._settings, self._job.threads)


def _journal(backend: PoseBackend, video: Video, stored: Path) -> AbstractContextManager[PoseBackend]:
    """``backend``, which remembers its answers where the video is long."""
    frames = video.info.frames_declared
    if frames is not None and frames <= _LONG:
        return nullcontext(backend)
    from gesture_core.run.workers.journal import remembering

    return remembering(backend, stored)


def _stored_name(sha256: str, key: str) -> str:
    """Where the keypoint store has the keypoints of a content, by the settings that ``key`` is a hash of."""
    return f"{sha256[:2]}/{sha256[:32]}-{key[:16]}.parquet"


def _checked(sequence: object, *, channels: bool) -> PoseSequence | Recording:
    wanted = Recording if channels else PoseSequence
    if not isinstance(sequence, wanted):
        raise TypeError(f"{type(sequence).__name__} instead of a {wanted.__name__}")
    return sequence


def _notes(sequence: PoseSequence | Recording) -> list[str]:
    """The clauses of what its reader noted."""
    return [note for note in sequence.provenance.get("notes", "").split("; ") if note]


def _above(sequence: PoseSequence, score: float) -> PoseSequence:
    """``sequence`` without the joints whose score is below ``score``."""
    import numpy as np

    unsure = sequence.scores < score
    return replace(sequence, keypoints=np.where(unsure[..., None], np.nan, sequence.keypoints))


class _Looked:
    """The frames of a video that are looked at, and what passes on the way, for the progress report.

    Attributes
    ----------
    seconds : float
        From the first frame to the latest.
    count : int
        Frames that were looked at.
    repeated : int
        Frames at the time of the one before.
    """

    def __init__(self, video: Video, rate: float | None, report: Callable[[dict[str, Any]], None]) -> None:
        self._video = video
        self._rate = rate
        self._report = report
        self._unreported = 0
        self.seconds = 0.0
        self.count = 0
        self.repeated = 0

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        from gesture_core.video import at_rate

        for frame in at_rate(self._passing(), self._rate):
            self.count += 1
            yield frame

    def _passing(self) -> Iterator[Picture]:
        from gesture_core.video import pictures

        reported, first, before = time.monotonic(), None, None
        for at, convert in pictures(self._video):
            first = at if first is None else first
            self.repeated += at == before
            before = at
            self.seconds = float(at - first)
            yield at, convert
            self._unreported += 1
            if time.monotonic() - reported > _REPORT_SECONDS:
                self.flush()
                reported = time.monotonic()

    @property
    def coarse(self) -> str:
        """What a clock that stands still means for what is looked at."""
        return (
            f"{self.repeated} frames have the time of the one before, and pose.rate looks at one of them; "
            "try: --set video.retime=RATE, or --set pose.rate=none"
        )

    def flush(self) -> None:
        """Report what has not been reported."""
        if self._unreported:
            self._report({"frames": self._unreported})
            self._unreported = 0
