"""Draws the pictures that are made of the demonstration archive: ``python docs/pictures.py``.

Nobody in them is real: the package draws its own people. They are to be drawn again after a new
packaged network, since they show what it sees.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from PIL import Image

from gesture_core import classify_archive, load_poses
from gesture_core.cli.main import run
from gesture_core.demo.archive import write_archive
from gesture_core.pose.overlay import overlay
from gesture_core.report.style import new_figure
from gesture_core.video import open_video

IMAGES = Path(__file__).resolve().parent / "images"
MOMENT = 0.45
"""Share of a clip after which its gesture is in full swing."""


def main() -> None:
    """Draw both pictures."""
    with tempfile.TemporaryDirectory() as folder:
        archive = write_archive(Path(folder) / "demo")
        out = Path(folder) / "run"
        rows = classify_archive(archive.videos, archive.examples, out).rows()
        one_each = {row.label: row for row in reversed(rows)}
        people(sorted(one_each.values(), key=lambda row: row.input))
        chosen = str(archive.videos / "clip_01.mp4")
        drawn = IMAGES / "explanation.png"
        run(["explain", str(out), chosen, "--out", str(drawn)])
        with Image.open(drawn) as picture:  # a page loads a quarter of the bytes
            few = picture.convert("RGB").quantize(256, dither=Image.Dither.NONE)
        few.save(drawn, optimize=True)


def people(rows: list) -> None:  # type: ignore[type-arg]
    """One moment of each clip with the keypoints that the network sees, its label and distance."""
    figure = new_figure(10.5, 2.35)
    for place, (row, axes) in enumerate(zip(rows, figure.subplots(1, len(rows)), strict=True)):
        poses = load_poses(row.input)
        with open_video(row.input) as video:
            pictures = [picture for _, picture in overlay(video, poses)]
        picture = pictures[int(MOMENT * len(pictures))]
        middle = picture.shape[1] // 2
        axes.imshow(picture[:, middle - 105 : middle + 105, ::-1])
        axes.set_title(f"{row.label}  {row.distance:.3f}", fontsize=10)
        axes.set_axis_off()
        print(place, row.input, row.label)
    figure.savefig(IMAGES / "demo.jpg", dpi=130, format="jpg", pil_kwargs={"quality": 88})


if __name__ == "__main__":
    main()
