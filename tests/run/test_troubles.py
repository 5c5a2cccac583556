"""Third parties' plugins crash, hang, starve and lie, stage by stage: each costs its input, never the run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from trouble_plugin import length
from troubles import CHAIN, classify, make_site, with_site, write_archive, write_video

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and limits of POSIX")

CRASH, HANG, MEMORY = "E_WORKER_CRASH", "E_WORKER_HANG", "E_WORKER_MEMORY"
DEATHS = {"os-exit": CRASH, "segfault": CRASH, "hungry": MEMORY}
STAGES = ("normalizer", "filter", "selector", "kernel")
CHAIN_POISONS = {
    **{(kind, trouble): code for kind in STAGES for trouble, code in DEATHS.items()},
    **{(kind, "raise"): "E_PLUGIN" for kind in STAGES},
    **{(kind, "none"): "E_PLUGIN_CONTRACT" for kind in STAGES},
    ("kernel", "hang"): HANG,
    ("filter", "nan"): "E_SIGNAL_VALUE",
    ("selector", "nan"): "E_PLUGIN_CONTRACT",
    ("kernel", "nan"): "E_PLUGIN_CONTRACT",
    ("kernel", "unprintable"): "E_PLUGIN_RAISED",
}
POSE_POISONS = {**DEATHS, "hang": HANG, "raise": "E_PLUGIN_RAISED", "shape": "E_", "none": "E_PLUGIN_RAISED"}
READER_POISONS = {
    "members segfault": CRASH,
    "members empty": "E_PLUGIN_CONTRACT",
    "members numbers": "E_PLUGIN_CONTRACT",
    "read os-exit": CRASH,
}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_site(tmp_path_factory.mktemp("site"))


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_every_stage_may_fail_in_every_way(site: Path, tmp_path: Path, thorough: bool) -> None:
    poisons = CHAIN_POISONS
    if not thorough:  # each way to die in one stage
        dies = dict(zip(STAGES, DEATHS, strict=False))
        poisons = {
            one: code for one, code in poisons.items() if one[1] not in DEATHS or one[1] == dies.get(one[0])
        }
    folder = tmp_path / "archive"
    write_archive(folder, 8, ())
    for number in range(4):
        write_video(folder / "videos" / f"film_{number}.avi", 64, 30, number % 2 == 0, number)
    options = (*CHAIN, "--pose", "trouble-pose", "--workers", "2")
    done, clean = classify(folder, tmp_path / "clean", site, *options)
    assert done == 0 and {row["status"] for row in clean.values()} == {"ok"}

    write_archive(folder, 0, poisons)
    expected = {f"{kind}_{trouble}.npz": code for (kind, trouble), code in poisons.items()}
    for trouble, code in POSE_POISONS.items():
        write_video(folder / "videos" / f"{trouble}.avi", 2 * length("pose", trouble), 30)
        expected[f"{trouble}.avi"] = code
    for number, (text, code) in enumerate(READER_POISONS.items()):
        (folder / "videos" / f"{number}.poison").write_text(text)
        expected[f"{number}.poison"] = code
    (folder / "videos" / "accepts.poison").write_text("accepts os-exit")
    exit_code, rows = classify(folder, tmp_path / "run", site, *options)
    assert exit_code == 3
    assert {name: rows.pop(name) for name in clean} == clean, "a plugin changed another input's row"
    unread = rows.pop("accepts.poison")
    assert unread["status"] == "error" and unread["code"] == CRASH and "trouble 6.6" in unread["message"]
    assert rows.keys() == expected.keys()
    for name, row in rows.items():
        assert row["code"].startswith(expected[name]) and row["status"] == "error", row
        assert row["label"] is None
        assert "trouble 6.6" in row["message"] + row["plugin"]
        if row["code"] in (CRASH, HANG):
            assert row["attempts"] == 2 or name.endswith(".poison"), row


WRITERS = {
    "": "",
    "os-exit": CRASH,
    "segfault": CRASH,
    "hungry": MEMORY,
    "hang": HANG,
    "raise": "E_PLUGIN_RAISED",
    "exit": "E_PLUGIN_RAISED",
    "none": "E_PLUGIN_CONTRACT",
}
EXPORT = """
import os, sys
from pathlib import Path
from gesture_core.run.export import export_rows
from gesture_core.errors import GestureError
from gesture_core.settings import LimitSettings

limits = LimitSettings(seconds=3, memory=700)
for trouble in sys.argv[2:]:
    os.environ["TROUBLE"] = trouble
    try:
        path = export_rows(Path(sys.argv[1]), "trouble-writer", None, limits)
        print(path.read_text()); path.unlink()
    except GestureError as error:
        print(error)
"""


def test_a_writer_may_fail_in_every_way(site: Path, tmp_path: Path) -> None:
    write_archive(tmp_path / "archive", 2, ())
    classify(tmp_path / "archive", tmp_path / "run", None, "--kernel", "numpy")
    before = sorted(path.name for path in (tmp_path / "run").iterdir())
    done = subprocess.run(
        [sys.executable, "-c", EXPORT, str(tmp_path / "run"), *WRITERS],
        env=with_site(site), capture_output=True, text=True, timeout=200,
    )  # fmt: skip
    said = done.stdout.splitlines()
    assert len(said) == len(WRITERS), done.stderr
    assert said[0] == "half"
    for line, code in zip(said[1:], list(WRITERS.values())[1:], strict=True):
        assert line.startswith(code) and "trouble 6.6" in line, line
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == before, "a file was left behind"


def test_a_plugin_that_cannot_even_start_stops_the_run_before_it_begins(tmp_path: Path) -> None:
    """What no input is to blame for is fatal, and nothing is written over."""
    from distributions import gesture, make_distribution

    site = make_distribution(
        tmp_path / "site",
        "stillborn",
        """
        import os
        from gesture_core import hookimpl

        class Filter:
            def __init__(self):
                os._exit(0)

        @hookimpl
        def register_filters(register):
            register("stillborn", "stillborn:Filter")
        """,
    )
    write_archive(tmp_path / "archive", 2, ())
    done = gesture(
        "classify", tmp_path / "archive" / "videos", "--examples", tmp_path / "archive" / "examples",
        "--out", tmp_path / "run", "--preset", "paper", "--set", "filters=stillborn", path=site,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert done.stderr.startswith("E_WORKER_CRASH") and "stillborn 1.0" in done.stderr


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_memory_and_compilations_do_not_grow_with_the_archive(site: Path, tmp_path: Path) -> None:
    from conftest import ROOT

    for right in (True, False):
        write_video(tmp_path / "examples" / ("right" if right else "left") / "1.avi", 64, 30, right)
    for number in range(200):
        write_video(tmp_path / "videos" / f"{number}.avi", 64, 8 + number * 7 % 50, number % 2 == 0, number)
    script = ROOT / "tests" / "run" / "many_videos.py"
    done = subprocess.run(
        [sys.executable, str(script), tmp_path / "videos", tmp_path / "examples", tmp_path / "run"],
        env=with_site(site), capture_output=True, text=True, timeout=280,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    *marks, last = done.stdout.splitlines()
    held = [int(mark.split()[1]) for mark in marks]
    programs, buckets, rows, ok = (int(part.split()[0]) for part in last.split(", "))
    assert rows == 200 and ok > 100
    assert programs <= buckets
    assert held[-1] - held[len(held) // 2] <= 16, held
