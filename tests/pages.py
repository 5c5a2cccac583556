"""What stands in a page: its blocks of code, its commands, its links; and a folder in which they can run."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gesture_core.demo.archive import DemoArchive

_BLOCK = re.compile(
    r"(?:<!-- not run: (?P<why>[^>]*) -->\n)?```(?P<kind>\w*)\n(?P<text>.*?)^```$", re.M | re.S
)
_COMMAND = re.compile(r"`(gesture [^`]+)`")


@dataclass(frozen=True)
class Block:
    """A block of code; ``why`` says why it is not run, where it is marked so."""

    kind: str
    text: str
    why: str = ""

    @property
    def commands(self) -> list[str]:
        """The lines of a shell block that call ``gesture``."""
        return [line for line in self.text.splitlines() if not self.kind and line.startswith("gesture ")]


def blocks(page: Path) -> list[Block]:
    """The blocks of code of a page."""
    found = _BLOCK.finditer(page.read_text("utf-8"))
    return [Block(match["kind"], match["text"], match["why"] or "") for match in found]


def spoken_commands(page: Path) -> Iterator[str]:
    """Commands in the text, with the first of what stands between bars."""
    text = re.sub(r"```.*?^```$", "", page.read_text("utf-8"), flags=re.M | re.S)
    for found in sorted(set(_COMMAND.findall(text))):
        yield found.replace("\\|", "|")


def table(page: Path, heading: str) -> list[list[str]]:
    """Cells of the table whose first heading is ``heading``."""
    rows = re.search(rf"^\| {re.escape(heading)} \|.*\n\|[-|]+\n((?:\|.*\n)+)", page.read_text("utf-8"), re.M)
    assert rows, heading
    escaped = rows[1].replace("\\|", "¦")
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in escaped.splitlines()]


def write_folder(drawn: DemoArchive, place: Path) -> Path:
    """What the pages suppose, mostly as keypoints: examples, videos, clips named by label, a table."""
    (place / "clips").mkdir(parents=True)
    listed = ["path,label"]
    for label in sorted(drawn.example_keypoints.iterdir()):
        (place / "examples" / label.name).mkdir(parents=True)
        (place / "examples" / label.name / "anna_1").symlink_to(label / "1")
        (place / "clips" / f"{label.name}_1").symlink_to(label / "1")
        listed.append(f"examples/{label.name}/anna_1,{label.name}")
    with drawn.truth.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            clip = Path(row["path"]).stem
            if not (ben := place / "examples" / row["label"] / "ben_2").exists():
                ben.symlink_to(drawn.video_keypoints / clip)
                listed.append(f"examples/{row['label']}/ben_2,{row['label']}")
    (place / "labels.csv").write_text("\n".join(listed) + "\n", encoding="utf-8")
    monday = place / "videos" / "monday"
    monday.mkdir(parents=True)
    (monday / "cam1_0001.mp4").write_bytes((drawn.videos / "clip_01.mp4").read_bytes())
    for number in range(2, 5):
        (monday / f"clip_{number}").symlink_to(drawn.video_keypoints / f"clip_{number:02d}")
    return place
