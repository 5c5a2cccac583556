"""Archives that are no folders: the rows are those of the same files in a folder, and no secret is kept."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from troubles import write_clip

from gesture_core import classify_archive, explain, load_poses
from gesture_core.cli.export import export
from gesture_core.errors import ConfigError, GestureError, InputError, RunFolderError
from gesture_core.files import cache_dir
from gesture_core.run import addresses
from gesture_core.run.addresses import entries, fetch, local_path, put, shown
from gesture_core.run.evaluate import labelled_inputs
from gesture_core.run.inputs import discover
from gesture_core.run.labels import label_inputs
from gesture_core.run.pipeline import RunSummary
from gesture_core.run.review import Answers, add_corrections, write_answers
from gesture_core.settings import Settings

fsspec = pytest.importorskip("fsspec", reason="fsspec is not installed: pip install 'gesture-core[s3]'")
SECRET = "hunter2"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """``examples`` of right and left, and four clips and a note in ``videos``."""
    monkeypatch.setenv("GESTURE_CACHE", str(tmp_path / "cache"))
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(tmp_path / "examples" / label / "1.npz", 40, joint)
        for number in range(2):
            write_clip(tmp_path / "videos" / f"day{number}" / f"{label}.npz", 30, joint, seed=number + 1)
    (tmp_path / "videos" / "note.txt").write_text("not a clip")
    (tmp_path / "videos" / "film.mp4").write_bytes(b"no film")
    return tmp_path


@pytest.fixture
def memory(folder: Path) -> Iterator[Any]:
    """The same archive in fsspec's file system in memory."""
    system = fsspec.filesystem("memory")
    for file in folder.rglob("*.*"):
        if file.is_file():
            system.pipe(f"/{file.relative_to(folder).as_posix()}", file.read_bytes())
    yield system
    system.store.clear()
    system.pseudo_dirs[:] = [""]


def classify(sources: Any, examples: Any, out: Path, **options: Any) -> RunSummary:
    return classify_archive(
        sources, examples, out, "paper", engine="inline", classify__kernel="numpy", **options
    )


def results(summary: RunSummary) -> list[tuple[Any, ...]]:
    """What the rows say, apart from where their inputs lie."""
    return [
        (
            row.input.rpartition("videos/")[2].partition("::")[0], row.sha256, row.label, row.distance,
            row.status, row.code, row.seconds,
        )
        for row in summary.rows()
    ]  # fmt: skip


def test_an_archive_in_memory_is_that_of_a_folder(folder: Path, memory: Any) -> None:
    expected = classify(folder / "videos", folder / "examples", folder / "run")
    summary = classify("memory://videos", "memory://examples", folder / "far")
    assert results(summary) == results(expected) and len(summary.rows()) == 6
    assert {row.input for row in summary.rows()} >= {
        "memory:///videos/note.txt", "memory:///videos/day0/left.npz"
    }  # fmt: skip
    assert not [file for file in (cache_dir() / "fetched").rglob("*") if file.is_file()]
    again = classify("memory://videos", "memory://examples", folder / "far")
    assert again.done_now == 0 and results(again) == results(expected)
    left = [file for file in (cache_dir() / "fetched").rglob("*.npz") if "videos" in str(file)]
    assert not left and not list((cache_dir() / "fetched").rglob("day*"))


def test_a_run_deletes_nothing_that_another_one_reads_and_leaves_nothing(folder: Path) -> None:
    with zipfile.ZipFile(folder / "archive.zip", "w") as archive:
        archive.write(folder / "videos" / "day0" / "left.npz", "left.npz")
    address = f"zip://::file://{folder / 'archive.zip'}"
    script = (
        "import sys; from gesture_core.run.addresses import entries, fetch\n"
        "for path, entry in entries(sys.argv[1]): fetch(entry, path); print(path, path.is_file())"
    )
    ((mine, entry),) = entries(address)
    fetch(entry, mine)
    done = subprocess.run([sys.executable, "-c", script, address], capture_output=True, text=True, check=True)
    other, there = done.stdout.split()
    assert there == "True" and Path(other) != mine and mine.is_file()
    assert not Path(other).parent.exists()


def test_what_is_replaced_is_done_again_and_what_is_gone_goes(folder: Path, memory: Any) -> None:
    classify("memory://videos", "memory://examples", folder / "far")
    memory.pipe("/videos/day0/left.npz", (folder / "videos" / "day1" / "right.npz").read_bytes())
    memory.rm("/videos/day1/left.npz")
    summary = classify("memory://videos", "memory://examples", folder / "far")
    assert (summary.done_now, summary.gone, len(summary.rows())) == (1, 1, 5)
    (row,) = [row for row in summary.rows() if row.input.endswith("day0/left.npz")]
    assert row.label == "right"
    # Of another address alone: the rows of this one are none of its business.
    assert classify("memory://examples", "memory://examples", folder / "far").gone == 0


@pytest.mark.parametrize("pattern", ["zip://::file://{}", "zip://videos/*/*.npz::file://{}"])
def test_a_zip_file_is_a_folder(folder: Path, pattern: str) -> None:
    with zipfile.ZipFile(folder / "archive.zip", "w") as archive:
        for file in sorted((folder / "videos").rglob("*.*")):
            archive.write(file, file.relative_to(folder))
    expected = classify(folder / "videos", folder / "examples", folder / "run")
    address = pattern.format(folder / "archive.zip")
    summary = classify(address, f"file://localhost{folder / 'examples'}", folder / "far")
    clips = [row for row in results(expected) if row[0].endswith(".npz") or "*" not in pattern]
    assert [(*row[1:],) for row in results(summary)] == [(*row[1:],) for row in clips]
    name = f"zip://videos/day0/left.npz::file://{folder / 'archive.zip'}"
    assert explain(folder / "far", name).explanation.nearest.label == "left"


@pytest.mark.parametrize("address", ["zip://examples::file://{}", "zip://examples/*/*.avi::file://{}"])
def test_videos_that_are_not_fetched_yet_have_the_labels_of_their_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    monkeypatch.setenv("GESTURE_CACHE", str(tmp_path / "cache"))
    with zipfile.ZipFile(tmp_path / "archive.zip", "w") as archive:
        for label in ("left", "right"):
            archive.writestr(f"examples/{label}/1.avi", b"RIFF\0\0\0\0AVI LIST")
    source = address.format(tmp_path / "archive.zip")
    found = label_inputs(list(discover([source])), "folder", [local_path(source)])
    assert [item.label for item in found] == ["left", "right"]


def test_addresses_of_folders_side_by_side_are_labels_and_those_of_clips_are_none(memory: Any) -> None:
    for sources, expected in (
        (["memory://examples/left", "memory://examples/right"], ["left", "right"]),
        (["memory://examples/left/1.npz", "memory://videos/day0/left.npz"], None),
        (["memory://videos/day0/left.npz", "memory://videos/day0/right.npz"], None),
    ):
        items, roots = list(discover(sources)), [local_path(source) for source in sources]
        if expected:
            assert [item.label for item in label_inputs(items, "folder", roots)] == expected
        else:
            with pytest.raises(ConfigError, match="no folder below the address"):
                label_inputs(items, "folder", roots)


def test_every_letter_may_be_in_a_name(folder: Path, memory: Any) -> None:
    clip = (folder / "videos" / "day0" / "left.npz").read_bytes()
    names = ("day0/what?1.npz", "day0/what?2.npz", "me@home/a.npz")
    with zipfile.ZipFile(folder / "archive.zip", "w") as archive:
        for name in names:
            archive.writestr(name, clip)
            memory.pipe(f"/odd/{name}", clip)
    address = f"zip://::file://{folder / 'archive.zip'}"
    summary = classify(address, folder / "examples", folder / "run")
    assert [row.input.partition("::")[0] for row in summary.rows()] == [f"zip://{name}" for name in names]
    assert {row.label for row in summary.rows()} == {"left"}
    of_one = f"zip://me@home::file://{folder / 'archive.zip'}"
    assert len(classify(of_one, folder / "examples", folder / "one").rows()) == 1
    summary = classify("memory://od*/day?/*.npz", folder / "examples", folder / "far")
    assert [row.status for row in summary.rows()] == ["ok", "ok"]


def test_a_name_that_is_an_object_and_a_folder_hides_nothing(memory: Any) -> None:
    found = [
        {"name": "/both", "type": "file", "size": 1, "created": 1},
        {"name": "/both", "type": "directory", "size": 0},
    ]

    class Both(type(memory)):  # type: ignore[misc]
        def ls(self, path: str, detail: bool = True, **_: Any) -> list[dict[str, Any]]:
            inside = [{"name": "/both/x.npz", "type": "file", "size": 1, "created": 1}]
            return inside if path.strip("/") else found

        def info(self, path: str, **_: Any) -> dict[str, Any]:
            return {"name": path, "type": "directory"}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(addresses, "_open", lambda address: (Both(), "/"))
        assert [entry.address for _, entry in entries("memory://")] == [
            "memory:///both", "memory:///both/x.npz"
        ]  # fmt: skip


def test_two_queries_are_not_one_input(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def listed(source: str) -> Any:
        yield tmp_path / "get.mp4", addresses.Entry(source, 1, "1", "")

    monkeypatch.setattr("gesture_core.run.inputs.entries", listed)
    pair = ["https://x.org/get.mp4?id=1", "https://x.org/get.mp4?id=2"]
    assert len(discover([pair[0], pair[0]])) == 1
    with pytest.raises(InputError, match="listed with two queries"):
        discover(pair)


@pytest.mark.parametrize("address", ["file://{}/examples", "zip://examples::file://{}/archive.zip"])
def test_folders_of_an_address_are_labels_for_every_command(folder: Path, address: str) -> None:
    with zipfile.ZipFile(folder / "archive.zip", "w") as archive:
        for file in sorted((folder / "examples").rglob("*.npz")):
            archive.write(file, file.relative_to(folder))
        archive.writestr("films/left/a.mp4", "no film")  # not fetched to be listed
        archive.writestr("films/right/a.mp4", "no film")
    each = "zip://films/left::file://{0}/archive.zip zip://films/right::file://{0}/archive.zip"
    for where in (address, "zip://films::file://{}/archive.zip", each):
        found = labelled_inputs(tuple(where.format(folder).split()), "folder", "", None, Settings())
        assert [item.label for item in found] == ["left", "right"]


def test_a_corrected_clip_of_a_zip_file_becomes_an_example(folder: Path) -> None:
    with zipfile.ZipFile(folder / "archive.zip", "w") as archive:
        for file in sorted((folder / "videos").rglob("*.npz")):
            archive.write(file, file.relative_to(folder))
    address = f"zip://::file://{folder / 'archive.zip'}"
    summary = classify(address, folder / "examples", folder / "run")
    with Answers(folder / "run") as answers:
        for place, (_, row) in enumerate(answers.rows):
            answers.give(place, "left" if row.label == "right" else "right")
        table = write_answers(answers.answered(), folder / "answers.csv").read_text("utf-8")
    assert f"zip://videos/day0/left.npz::file://{folder / 'archive.zip'},right" in table
    (folder / "list.txt").write_text("".join(line.split(",")[0] + "\n" for line in table.splitlines()[1:]))
    assert [(one.name, one.label) for one in discover([folder / "list.txt"])] == [
        (row.input, None) for row in summary.rows()
    ]
    by_table = classify(address, folder / "answers.csv", folder / "by-table", labels="folder")
    assert [row.label for row in by_table.rows()] == ["right", "left"] * 2  # what the table says each one is
    (folder / "run" / "run.fitted").unlink()  # as after a run of an earlier version
    with pytest.raises(RunFolderError, match="with --overwrite"):
        add_corrections(folder / "run", folder / "more")
    classify(address, folder / "examples", folder / "run", overwrite=True)
    added = add_corrections(folder / "run", folder / "more").added
    assert added and all(path.stat().st_size for path in added)


def test_names_with_two_colons_are_names(folder: Path, memory: Any) -> None:
    data = (folder / "videos" / "day0" / "left.npz").read_bytes()
    memory.pipe("/odd/cam::1/a::b.npz", data)
    with zipfile.ZipFile(folder / "archive.zip", "w") as archive:
        archive.writestr("cam::1/a::b.npz", data)
    for number, address in enumerate(("memory://odd", f"zip://::file://{folder / 'archive.zip'}")):
        (row,) = classify(address, folder / "examples", folder / f"run{number}").rows()
        assert row.label == "left" and "cam::1/a::b.npz" in row.input
        (again,) = classify(row.input, folder / "examples", folder / f"again{number}").rows()
        assert again == row
    assert explain(folder / "run1", row.input).explanation.nearest.label == "left"


def test_an_address_with_a_password_is_refused_and_a_signature_is_never_kept(
    folder: Path, memory: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="holds a name or password") as caught:
        list(entries(f"s3://me:{SECRET}@bucket/videos"))
    assert SECRET not in str(caught.value)
    assert shown(f"https://example.org/a.mp4?X-Amz-Signature={SECRET}") == "https://example.org/a.mp4"
    assert shown("videos/clip?.mp4") == "videos/clip?.mp4"
    assert shown(f"https://me:{SECRET}@example.org/a@b.mp4") == "https://example.org/a@b.mp4"
    error = addresses._failed(f"https://x.org/a?sig={SECRET}", OSError(f"GET /a?sig={SECRET} failed"))
    assert SECRET not in str(error)
    error = addresses._failed("https://x.org/a", OSError(f"403, url='https://y.org/b?sig={SECRET}&c=1'"))
    assert SECRET not in str(error) and "https://y.org/b" in str(error)
    monkeypatch.setattr("gesture_core.run.inputs.entries", lambda source: iter(()))
    with pytest.raises(InputError) as empty:
        load_poses(f"https://x.org/a/?sig={SECRET}")
    assert SECRET not in str(empty.value)
    with pytest.warns(UserWarning, match="holds nothing to read: https://x.org/a/$"):
        discover([folder / "videos", f"https://x.org/a/?sig={SECRET}"])
    item = next(iter(entries("memory://videos")))[1]
    assert SECRET not in repr(addresses.Entry(shown(item.address), 1, "", ""))


def test_no_name_leads_out_of_the_folder(tmp_path: Path) -> None:
    for parts in (["..", "..", "etc", "passwd"], [".", "a"], ["", "b"], ["x" * 300 + ".mp4"]):
        place = addresses._safe(parts)
        assert ".." not in place.parts and not place.is_absolute() and len(place.name) < 250
    assert addresses._safe(["..", "a"]) != addresses._safe(["_", "a"]) != addresses._safe([".", "a"])
    assert local_path("videos/") == "videos/" and local_path("file:///a/b%20c") == "/a/b c"
    assert local_path("file://localhost/a") == "/a" and local_path("file://localhosts/a") != "s/a"
    shutil.rmtree(tmp_path, ignore_errors=True)


def test_errors_are_of_the_package(memory: Any) -> None:
    for address in ("memory://none/at/all", "zip://x::memory://videos/note.txt", "http://["):
        with pytest.raises(GestureError):
            list(entries(address))


def test_a_table_and_a_folder_of_events_are_written_to_an_address(
    folder: Path, memory: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    classify(folder / "videos", folder / "examples", folder / "run")
    bucket = f"local://{(folder / 'bucket').as_posix()}"
    (folder / "bucket").mkdir()
    export(folder / "run", to=f"{bucket}/rows.csv")
    assert capsys.readouterr().out == f"{bucket}/rows.csv\n"
    export(folder / "run", to="file://" + (folder / "rows.csv").as_posix())
    assert (folder / "bucket" / "rows.csv").read_bytes() == (folder / "rows.csv").read_bytes()
    export(folder / "run", format="datasets", to=f"{bucket}/rows.parquet")
    export(folder / "run", to=f"{bucket}/a::b.parquet")
    assert (folder / "bucket" / "a::b.parquet").read_bytes().startswith(b"PAR1"), "the whole name says it"
    with pytest.raises(ConfigError, match="would be gone with this command"):
        export(folder / "run", to="memory://bucket/rows.csv")
    (folder / "tree" / "below").mkdir(parents=True)
    (folder / "tree" / "below" / "a.vtt").write_text("WEBVTT")
    put(folder / "tree", "memory://bucket/events/")
    assert memory.cat("/bucket/events/below/a.vtt") == b"WEBVTT"

    def refuse(*_: Any, **__: Any) -> None:
        raise PermissionError("not yours")

    monkeypatch.setattr(fsspec.get_filesystem_class("local"), "put_file", refuse)
    with pytest.raises(InputError, match=r"cannot be written: .*not yours") as failed:
        export(folder / "run", to=f"{bucket}/rows.csv")
    assert failed.value.code == "E_OUT"
