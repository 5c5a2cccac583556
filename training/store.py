"""A cache of training pictures: uint8 arrays mapped into memory, so that no loader decodes anything."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .joints import COUNT


@dataclass
class Store:
    """What `Writer` wrote, opened for reading.

    Attributes
    ----------
    pictures : (N, S, S, 4) uint8
        BGR and the mask (see `cutout`; for renders the fourth plane is opacity).
    joints : (N, 18, 3) float32
        x, y in pixels of the stored square, and what is known of the joint.
    groups : (N,) int
        Index into ``names``.
    bottoms : (N,) float32
        Row below which the picture has nothing: a person cut there must stay cut.
    """

    pictures: np.ndarray
    joints: np.ndarray
    groups: np.ndarray
    bottoms: np.ndarray
    names: list[str]

    def __len__(self) -> int:
        return len(self.joints)

    @classmethod
    def open(cls, folder: Path) -> Store:
        """Map the store in ``folder``; FileNotFoundError where it is not complete."""
        index = json.loads((folder / "index.json").read_text(encoding="utf-8"))
        table = np.load(folder / "table.npz", allow_pickle=False)
        pictures = np.memmap(
            folder / "pictures.u8", np.uint8, "r", shape=(index["capacity"], index["side"], index["side"], 4)
        )
        count = len(table["joints"])
        return cls(pictures[:count], table["joints"], table["groups"], table["bottoms"], index["names"])


class Writer:
    """Appends samples to a store, and remembers which inputs are done, so that it can go on.

    Parameters
    ----------
    folder : Path
    side : int
        Pixels of a stored square.
    capacity : int
        The most samples; the file is sparse, so that an unused rest costs nothing.
    """

    def __init__(self, folder: Path, side: int, capacity: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.side, self.capacity = folder, side, capacity
        path = folder / "pictures.u8"
        mode = "r+" if path.exists() else "w+"
        self._pictures = np.memmap(path, np.uint8, mode, shape=(capacity, side, side, 4))
        self._joints: list[np.ndarray] = []
        self._groups: list[int] = []
        self._bottoms: list[float] = []
        self._names: list[str] = []
        self._done: set[str] = set()
        partial = folder / "partial.npz"
        if partial.exists():
            table = np.load(partial, allow_pickle=False)
            notes = json.loads((folder / "partial.json").read_text(encoding="utf-8"))
            self._joints, self._groups = list(table["joints"]), table["groups"].tolist()
            self._bottoms = table["bottoms"].tolist()
            self._names, self._done = notes["names"], set(notes["done"])

    def __len__(self) -> int:
        return len(self._joints)

    def done(self, key: str) -> bool:
        """Whether the input called ``key`` was finished, now or in an earlier run."""
        return key in self._done

    def add(
        self,
        picture: np.ndarray,
        mask: np.ndarray,
        points: np.ndarray,
        known: np.ndarray,
        group: str,
        bottom: float,
    ) -> None:
        """Append one sample; beyond the capacity samples are left out."""
        if len(self) >= self.capacity:
            return
        if group not in self._names:
            self._names.append(group)
        row = self._pictures[len(self)]
        row[..., :3], row[..., 3] = picture, mask
        self._joints.append(np.column_stack([points, known]).astype(np.float32))
        self._groups.append(self._names.index(group))
        self._bottoms.append(bottom)

    def mark(self, key: str) -> None:
        """Note that the input called ``key`` is finished."""
        self._done.add(key)
        if len(self._done) % 10 == 0:
            self._save("partial")

    def _save(self, name: str) -> None:
        self._pictures.flush()
        joints = np.stack(self._joints) if self._joints else np.zeros((0, COUNT, 3), np.float32)
        np.savez(
            self.folder / f"{name}.npz",
            joints=joints,
            groups=np.array(self._groups, np.int64),
            bottoms=np.array(self._bottoms, np.float32),
        )
        notes = {"names": self._names, "done": sorted(self._done)}
        (self.folder / f"{name}.json").write_text(json.dumps(notes), encoding="utf-8")

    def close(self) -> Store:
        """Write the table and open the store."""
        self._save("partial")
        self._save("table")
        notes = {"side": self.side, "capacity": self.capacity, "names": self._names}
        (self.folder / "index.json").write_text(json.dumps(notes), encoding="utf-8")
        return Store.open(self.folder)
