"""Postures: a picture is an input of one frame under the preset for them, and no input otherwise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gesture_core import classify_archive
from gesture_core.cli.main import run
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import MediaError
from gesture_core.records import VideoLimits
from gesture_core.settings.schema import VideoSettings
from gesture_core.video import open_video

pytestmark = pytest.mark.usefixtures("in_this_process")

cv2 = pytest.importorskip("cv2")
STILLS = VideoSettings(pictures=True)


def save(path: Path, picture: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), picture)
    return path


@pytest.mark.parametrize("name", ["a.jpg", "b.JPEG", "c.png"])
def test_a_picture_is_a_video_of_one_frame(name: str, tmp_path: Path) -> None:
    picture = np.full((40, 60, 3), 90, np.uint8)
    with open_video(save(tmp_path / name, picture), rates=STILLS) as video:
        ((time, frame),) = list(video)
    assert time == 0 and frame.shape == (40, 60, 3) and abs(int(frame[3, 3, 0]) - 90) < 3
    assert video.report.complete and video.info.width == 60 and video.info.reader == "picture"
    with pytest.raises(MediaError, match="E_MEDIA_FORMAT"):
        open_video(tmp_path / name)


def test_a_picture_is_not_decoded_before_its_size_is_known(tmp_path: Path) -> None:
    path = save(tmp_path / "a.png", np.zeros((40, 60, 3), np.uint8))
    with pytest.raises(MediaError, match="60 x 40 pixels"):
        open_video(path, limits=VideoLimits(max_pixels=1000), rates=STILLS)
    whole = path.read_bytes()
    for content, code in ((b"", "EMPTY"), (b"\xff\xd8\xff\xe0no", "FORMAT"), (b"GIF89a" + whole, "FORMAT")):
        path.write_bytes(content)
        with pytest.raises(MediaError, match=f"E_MEDIA_{code}"):
            open_video(path, rates=STILLS)


def test_a_folder_of_pictures_has_a_row_for_each(drawn: DemoArchive, tmp_path: Path) -> None:
    for path in sorted(drawn.examples.glob("*/*.mp4"))[:2]:
        with open_video(path) as video:
            frames = [frame for _, frame in video]
        for name, frame in (("1.png", frames[0]), ("2.jpg", frames[1])):
            save(tmp_path / "examples" / path.parent.name / name, frame)
        save(tmp_path / "pictures" / f"{path.parent.name}.jpg", frames[2])
    picture = str(next((tmp_path / "pictures").iterdir()))
    assert run(["render", picture, "--preset", "pose", "--out", str(tmp_path / "seen.png")]) == 0
    (tmp_path / "pictures" / "z.jpg").write_bytes(b"\xff\xd8\xff")
    *rows, broken = classify_archive(
        tmp_path / "pictures", tmp_path / "examples", None, "pose", engine="inline"
    ).rows()
    assert {row.status for row in rows} == {"ok"} and {row.frames_read for row in rows} == {1}
    assert broken.code == "E_MEDIA_FORMAT"
    others = classify_archive(tmp_path / "pictures", drawn.examples, None, engine="inline", pose__rate=3.0)
    assert {row.status for row in others.rows()} == {"skipped"}
    assert "--preset pose" in others.rows()[0].message


def test_the_size_of_a_picture_is_not_looked_for_behind_a_marker_that_hides_it(tmp_path: Path) -> None:
    whole = cv2.imencode(".jpg", np.zeros((64, 48, 3), np.uint8))[1].tobytes()
    hidden = whole[:2] + b"\xff\xd0" + whole[2:]
    place = 4 + int.from_bytes(hidden[4:6], "big")  # where a reader looks next that takes the length for one
    data = hidden.ljust(place, b"\0") + b"\xff\xc0\x00\x0b\x08\x00\x01\x00\x01" + bytes(10)
    (tmp_path / "a.jpg").write_bytes(data)
    with pytest.raises(MediaError) as caught:
        open_video(tmp_path / "a.jpg", limits=VideoLimits(max_pixels=100), rates=STILLS)
    assert caught.value.code == "E_MEDIA_FORMAT"
