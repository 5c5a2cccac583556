"""Which keypoint reader takes a file or a folder: one of people, or one of channels."""

from __future__ import annotations

from collections.abc import Sequence, Set
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from gesture_core.errors import GestureError, PluginError, WorkerError
from gesture_core.plugin.registry import Registration, registry
from gesture_core.records import encoded
from gesture_core.run.workers.engines import Assistant

if TYPE_CHECKING:
    from gesture_core.run.workers.keypoints import Answer

_SAVE = "save it as CSV, with columns such as {names}"
_OTHERS = {
    suffix: said
    for suffixes, said in (
        (".xlsx .xlsm .xls .ods .numbers", f"a spreadsheet: {_SAVE}"),
        (".zip .7z .rar .tar .tgz .gz .bz2 .xz .zst", "an archive: unpack it"),
        (".rds .rda .rdata .sav .dta .sas7bdat", f"data of a statistics program: {_SAVE}"),
        (".pt .pth", "a pickle of PyTorch, which can run any code: save the array once, with numpy.save"),
        (".slp", "a project of SLEAP: sleap-convert --format analysis makes a file that is read"),
        (".skeleton", f"a skeleton file of NTU: {_SAVE}"),
        (".fbx .mot .sto .amc .vmd", f"angles of joints: export the places of the joints, {_SAVE}"),
        (".glb .gltf .usd", f"a motion capture in three dimensions: export .trc, or {_SAVE}"),
        (".cwa .gt3x .mtb .mvnx", f"a log in the device's own form: {_SAVE}"),
        (".dat .asc .out", "perhaps a table of numbers: call it .txt"),
    )
    for suffix in suffixes.split()
}
"""What people bring that nobody reads here, and what to do with it."""
_TOGETHER = 1000
"""Paths that a reader is asked about at once."""


class Readers:
    """Whose keypoint file is it? Readers are asked in a worker, and only about what may be theirs.

    Attributes
    ----------
    channels : bool
        Inputs are recordings of channels instead of people.
    pictures : bool
        Pictures are inputs of one frame.
    suffixes : frozenset of str
        Those that readers announce.
    """

    def __init__(self, assistant: Assistant) -> None:
        plugins = registry()
        self._assistant = assistant
        self.channels = assistant.settings["signals"]["input"] == "channels"
        self.pictures = bool(assistant.settings["video"]["pictures"])
        usable = plugins.names("reader", usable=True)
        every = [plugins.find("reader", name) for name in usable]
        self._every = [reader for reader in every if reader.channels == self.channels]
        self._of_channels = [reader for reader in every if reader.channels]
        self.suffixes = frozenset(suffix for reader in self._every for suffix in reader.suffixes)
        self._lacking = [
            entry
            for name in plugins.names("reader")
            if name not in usable and len(entries := plugins.entries["reader", name]) == 1
            for entry in entries
            if entry.channels == self.channels
        ]
        self._answers: dict[tuple[str, Path], Answer] = {}

    def expect(self, files: Sequence[Path]) -> None:
        """Ask about many files at once, of which `of` is going to be asked one by one."""
        self._answers.clear()
        for reader in self._every:
            mine = [file for file in files if _may_take(reader, file)]
            for start in range(0, len(mine), _TOGETHER):
                some = mine[start : start + _TOGETHER]
                with suppress(
                    WorkerError
                ):  # one of them did it; each is asked about alone when its turn comes
                    answers = self._ask(reader, some, retry=False)
                    self._answers |= {
                        (reader.name, file): answer for file, answer in zip(some, answers, strict=True)
                    }

    def of(self, path: Path, inside: Set[str] | None = None) -> tuple[str, tuple[str, str] | None]:
        """The first reader by name that takes ``path``; or none, with code and cause of others' failures.

        ``inside`` are the suffixes of the files in ``path``, where it is a folder.
        """
        faults = []
        for reader in self._every:
            if not _may_take(reader, path, inside):
                continue
            answer = self._answers.get((reader.name, path))
            try:
                answer = self._ask(reader, [path])[0] if answer is None else answer
            except WorkerError as error:
                answer = error.code, f"{reader}: {error.cause}"
            if answer is True:
                return reader.name, None
            if answer:
                faults.append(answer)
        for reader in self._lacking:
            if reader.suffixes and _may_take(reader, path, inside):
                cause = f"{reader.title} needs {', '.join(reader.missing)}: {reader.install}"
                faults.append(("E_MISSING_DEPENDENCY", cause))
        return "", (faults[0][0], "; ".join(cause for _, cause in faults)) if faults else None

    def may_take(self, name: str, path: Path) -> bool:
        """Whether the file ``path`` is called as those of a reader are."""
        return any(reader.name == name and _may_take(reader, path) for reader in self._every)

    def why_not(self, path: Path) -> str:
        """Why no reader takes the file ``path``: what the readers of files with such a name say of it."""
        if path.stat().st_size == 0:
            return "is empty, 0 bytes"
        near = [reader for reader in self._every if reader.suffixes and _may_take(reader, path)]
        causes = []
        for reader in near:
            try:
                cause = self._assistant.ask("refusal", {"reader": reader.name, "path": encoded(path)})
            except GestureError as error:
                cause = error.cause
            except OSError as error:
                cause = f"cannot be read: {error.strerror or error}"
            causes += [f"{reader.name}: {cause}"] if cause else []
        if causes:
            hint = (
                "; as channels of a sensor it is read with --preset sensors" if self._is_series(path) else ""
            )
            return f"no reader takes it; {'; '.join(causes)}{hint}"
        if near:
            return f"no reader takes it, not {' nor '.join(reader.name for reader in near)}"
        known = _OTHERS.get(path.suffix.lower())
        if self._is_series(path):
            known = "series of channels, which --preset sensors reads"
        names = "acc_x, acc_y" if self.channels else "nose_x, nose_y"
        but = f", but {known.format(names=names)}" if known else ""
        if self.channels:
            return f"no series of channels, which signals.input = channels (--preset sensors) wants{but}"
        return f"neither a video nor a keypoint file{but}"

    def _is_series(self, path: Path) -> bool:
        """Whether what no reader of people takes is a series of channels."""
        some = [] if self.channels else [reader for reader in self._of_channels if _may_take(reader, path)]
        with suppress(WorkerError):
            return any(self._ask(reader, [path])[0] is True for reader in some)
        return False

    def members(self, reader: str, path: Path) -> list[str]:
        """Names of the sequences in ``path``; a PluginError where the reader ends its process."""
        try:
            found: list[str] = self._assistant.ask("members", {"reader": reader, "path": encoded(path)})
        except WorkerError as error:
            entry = registry().find("reader", reader)
            raise PluginError(f"{entry}: {error.cause}", code=error.code) from error
        return found

    def _ask(self, reader: Registration, paths: Sequence[Path], *, retry: bool = True) -> list[Answer]:
        task = {"reader": reader.name, "paths": [encoded(path) for path in paths]}
        answers = self._assistant.ask("accepts", task, retry=retry)
        return [answer if isinstance(answer, bool) else (answer[0], answer[1]) for answer in answers]


def is_text_of_series(path: Path) -> bool:
    """Whether a ``.ts`` is the text of the UEA archive and no video, which is called so as well."""
    if path.suffix.lower() != ".ts" or not path.is_file():
        return False
    with suppress(OSError), path.open("rb") as file:
        return file.read(1) in (b"#", b"@")
    return False


def _may_take(reader: Registration, path: Path, inside: Set[str] | None = None) -> bool:
    """Whether a reader, by what it has announced, is to be asked about a file or a folder."""
    if inside is None:
        return not reader.suffixes or path.name.lower().endswith(tuple(reader.suffixes))
    return not reader.suffixes or (reader.folders and not inside.isdisjoint(reader.suffixes))
