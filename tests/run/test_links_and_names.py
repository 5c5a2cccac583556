"""Archives of links, and videos under any name: what is a file is read, and nothing else."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from troubles import write_clip

from gesture_core import classify_archive, load_poses
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import GestureError, InputError, MediaError
from gesture_core.files import content_sha256, unreadable
from gesture_core.run.inputs import Input, discover
from gesture_core.video import open_video

pytestmark = pytest.mark.skipif(os.name != "posix", reason="links and devices of POSIX")


def one(path: Path) -> Input:
    (item,) = discover([path])
    return item


def annexed(path: Path, store: Path) -> Path:
    """Move the content of ``path`` into a store, as git-annex does, and leave a link."""
    target = store / ".git" / "annex" / "objects" / path.parent.name / path.name / f"SHA256E--{path.name}"
    target.parent.mkdir(parents=True)
    path.rename(target)
    path.symlink_to(os.path.relpath(target, path.parent))
    return target


def test_an_archive_of_links_is_read_like_the_files(tmp_path: Path, drawn: DemoArchive) -> None:
    """Videos, arrays, single frames of OpenPose JSON, and whole folders of frames."""
    plain, linked = tmp_path / "plain", tmp_path / "linked"
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(plain / label / "1.npz", 40, joint)
    shutil.copytree(drawn.example_keypoints / "wave" / "1", plain / "frames")
    shutil.copytree(plain, linked)
    files = [path for path in linked.rglob("*") if path.is_file()]
    for number, path in enumerate(files):
        if path.suffix == ".npz" or number % 3 == 0:
            annexed(path, tmp_path / "store")
    (tmp_path / "ways").mkdir()
    (tmp_path / "ways" / "frames").symlink_to(linked / "frames", target_is_directory=True)
    before, after = load_poses(plain), load_poses(linked)
    assert len(before) == len(after) == 3
    for a, b in zip(before, after, strict=True):
        np.testing.assert_array_equal(a.keypoints, b.keypoints)
    (through,) = load_poses(tmp_path / "ways")
    np.testing.assert_array_equal(through.keypoints, before[0].keypoints)
    for path in (Path("right/1.npz"), Path("frames")):
        assert content_sha256(plain / path) == content_sha256(linked / path), "keys are of the content"


def test_a_link_without_its_content_names_the_remedy(tmp_path: Path) -> None:
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(tmp_path / "examples" / label / "1.npz", 40, joint)
        write_clip(tmp_path / "videos" / f"{label}.npz", 30, joint, seed=1)
    annexed(tmp_path / "videos" / "left.npz", tmp_path / "store").unlink()
    annexed(tmp_path / "examples" / "left" / "1.npz", tmp_path / "store").unlink()
    (tmp_path / "videos" / "hub.mp4").symlink_to("../../blobs/1234")
    (tmp_path / "videos" / "data.mp4").symlink_to("/home/x/.dvc/cache/files/md5/12/34")
    (tmp_path / "videos" / "other.mp4").symlink_to("elsewhere.mp4")
    summary = classify_archive(tmp_path / "videos", tmp_path / "examples", tmp_path / "run", "paper")
    said = {Path(row.input).name: (row.status, row.message) for row in summary.rows() if row.code}
    assert {status for status, _ in said.values()} == {"error"}
    for name, words in {
        "left.npz": "git annex get left.npz",
        "hub.mp4": "the cache of a hub",
        "data.mp4": "dvc pull",
        "other.mp4": "leads nowhere, to elsewhere.mp4",
    }.items():
        assert words in said[name][1], said
    (failed,) = summary.failed_examples
    assert "git annex get 1.npz" in failed.message and summary.exit_code == 3
    with pytest.raises(InputError, match="git annex get"):
        load_poses(tmp_path / "videos" / "left.npz")


def test_a_frame_whose_content_is_not_here_is_named(tmp_path: Path, drawn: DemoArchive) -> None:
    shutil.copytree(drawn.example_keypoints / "wave" / "1", tmp_path / "k" / "1")
    frame = sorted((tmp_path / "k" / "1").iterdir())[3]
    annexed(frame, tmp_path / "store").unlink()
    with pytest.raises(GestureError, match="git annex get"):
        load_poses(tmp_path / "k")
    for other in sorted((tmp_path / "k" / "1").iterdir()):
        if other.exists():
            annexed(other, tmp_path / "store").unlink()
    clip, first = discover([tmp_path / "k"])
    assert clip.path == first.path.parent == tmp_path / "k" / "1", "a row for each frame is too many"


@pytest.mark.parametrize("what", ["loop", "fifo", "device", "proc", "link to proc", "socket"])
def test_what_is_no_file_is_refused(tmp_path: Path, what: str) -> None:
    path = tmp_path / "in" / "clip.mp4"
    path.parent.mkdir()
    if what == "loop":
        path.symlink_to(path)
    elif what == "fifo":
        os.mkfifo(tmp_path / "pipe")
        path.symlink_to(tmp_path / "pipe")
    elif what == "socket":
        import socket

        with socket.socket(socket.AF_UNIX) as server:
            server.bind(str(path))
    elif what == "device":
        path.symlink_to("/dev/zero")
    elif not Path("/proc/self/environ").exists():
        pytest.skip("no /proc here")
    elif what == "proc":
        path = Path("/proc/self/environ")
    else:
        path.symlink_to("/proc/kcore" if Path("/proc/kcore").exists() else "/proc/self/environ")
    assert unreadable(path) is not None
    item = one(path)
    assert item.kind == "broken" and item.fault and item.remedy
    with pytest.raises(MediaError):
        open_video(path)
    with pytest.raises(OSError):
        content_sha256(path)


def test_pointers_are_told_from_content(tmp_path: Path) -> None:
    lfs = b"version https://git-lfs.github.com/spec/v1\noid sha256:12\nsize 34\n"
    (tmp_path / "a.mp4").write_bytes(lfs)
    with pytest.raises(MediaError, match=r"pointer of Git LFS.*git lfs pull"):
        open_video(tmp_path / "a.mp4")
    (tmp_path / "b.mp4").write_bytes(b"/annex/objects/SHA256E-s1--2.mp4\n")
    with pytest.raises(MediaError, match=r"git annex get b\.mp4"):
        open_video(tmp_path / "b.mp4")
    folder = tmp_path / "keypoints"
    folder.mkdir()
    for suffix in ("npz", "npy", "csv", "json", "parquet", "mat"):
        (folder / f"c.{suffix}").write_bytes(lfs)
    for name in ("d.mp4.dvc", "e.mp4.dvc"):
        (folder / name).write_text("outs:\n- md5: 12\n")
    (folder / "e.mp4").write_bytes(b"its content")
    (folder / "f.npz").touch()
    found = {item.path.name: item for item in discover([folder])}
    remedies = {name: item.remedy for name, item in found.items() if item.kind == "broken"}
    assert remedies.pop("d.mp4.dvc") == "dvc pull"
    assert len(remedies) == 6 and set(remedies.values()) == {"git lfs pull"}
    assert found["f.npz"].fault == "is empty, 0 bytes" and found["e.mp4.dvc"].kind == "other"
    with pytest.raises(InputError, match=r"no such file.*ffmpeg -framerate 25"):
        discover([tmp_path / "%04d.jpg"])


NAMES = (
    "wave_0", "a.lrv", "b.insv", "c.mod", "d.divx", "e.mp4.part", "f.mp4 ", "g.mp4.1", "h.JSV", "i.dat",
    "j.json", "k.csv", "l.JPG", "m.txt", "n.npz", "o.parquet", "p.xml", "q.csv.gz", "r.zip", "s.mat",
)  # fmt: skip


def test_a_video_is_one_under_any_name(drawn: DemoArchive, tmp_path: Path) -> None:
    folder = tmp_path / "clips"
    folder.mkdir()
    for name in NAMES:
        shutil.copy(drawn.videos / "clip_01.mp4", folder / name)
    (tmp_path / "list.txt").write_text("".join(f"clips/{name}\n" for name in NAMES))
    for sources in ([folder], [folder / name for name in NAMES], [tmp_path / "list.txt"]):
        found = {item.path.name: item.kind for item in discover(sources)}
        assert found == dict.fromkeys(NAMES, "video")


def test_streams_without_a_container_are_known_by_their_first_unit(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="clips are made with PyAV")
    streams = {"h264": "libx264", "hevc": "libx265", "m4v": "mpeg4", "dv": "dvvideo", "apng": "apng"}
    for number, (container, encoder) in enumerate(streams.items()):
        size = (720, 576) if container == "dv" else (64, 64)
        pixels = "rgb24" if container == "apng" else "yuv420p"
        with av.open(str(tmp_path / f"clip_{number}"), "w", format=container) as out:
            stream = out.add_stream(encoder, rate=25)
            (stream.width, stream.height), stream.pix_fmt = size, pixels
            for shade in range(4):
                picture = np.full((size[1], size[0], 3), 20 * shade, np.uint8)
                out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "bgr24").reformat(format=pixels)))
            out.mux(stream.encode())
        assert one(tmp_path / f"clip_{number}").kind == "video"
        with open_video(tmp_path / f"clip_{number}", "pyav") as video:
            assert video.info.container == container and sum(1 for _ in video) == 4


def test_a_file_of_a_video_cd_is_a_video(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="clips are made with PyAV")
    with av.open(str(tmp_path / "clip.mpg"), "w", format="vcd") as out:
        stream = out.add_stream("mpeg1video", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        noise = np.random.default_rng(0)
        for _ in range(30):
            picture = noise.integers(0, 255, (64, 64, 3), np.uint8)
            out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "bgr24")))
        out.mux(stream.encode())
    stored, disc = (tmp_path / "clip.mpg").read_bytes(), b"RIFF\0\0\0\0CDXAfmt " + bytes(28)
    for start in range(0, len(stored), 2324):  # sectors of 2,352 bytes
        sector = stored[start : start + 2324].ljust(2324, b"\0")
        disc += b"\0" + b"\xff" * 10 + b"\0" + bytes(12) + sector + bytes(4)
    (tmp_path / "AVSEQ01.DAT").write_bytes(disc)
    assert one(tmp_path / "AVSEQ01.DAT").kind == "video"
    counts = []
    for name in ("clip.mpg", "AVSEQ01.DAT"):
        with open_video(tmp_path / name, "pyav") as video:
            counts.append(sum(1 for _ in video))
    assert counts[0] == 30 and counts[1] >= 29, "the demuxer may keep the last picture to itself"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("photo.heif", b"\0\0\0\x18ftypheic" + bytes(64)),
        ("song", b"\0\0\0\x18ftypM4A " + bytes(64)),
        ("song.m4a", b"\0\0\0\x18ftypisom" + bytes(64)),
        ("sound", b"OggS" + bytes(24) + b"\x01vorbis" + bytes(64)),
        ("LICENSE", b"The free software, and no box of that size"),
        ("notes.txt", b"the free software, and no box of that size" * 100),
        ("data.json", b'{"a"free' + bytes(64)),
        ("thumb.jpg", b"\xff\xd8\xff\xe0" + bytes(64)),
        ("Makefile", b"GNU = make\n" * 40),
        ("nothing", b""),
    ],
)
def test_what_is_no_video_is_passed_over_as_before(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    item = one(tmp_path)
    assert item.kind == "other" and item.fault


def test_files_beside_clips_of_their_names_are_no_lost_examples(tmp_path: Path) -> None:
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(tmp_path / "examples" / label / "1.npz", 40, joint)
        for name in ("1.npz.dvc", "1.eaf"):
            (tmp_path / "examples" / label / name).write_text("outs: []")
    write_clip(tmp_path / "in" / "a.npz", 30, 4, seed=1)
    with pytest.warns(UserWarning, match="files beside clips of their names: 4"):
        summary = classify_archive(tmp_path / "in", tmp_path / "examples", tmp_path / "run", "paper")
    assert summary.exit_code == 0 and not summary.failed_examples
