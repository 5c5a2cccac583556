"""`gesture evaluate` and `gesture explain` from end to end on keypoint files."""

from __future__ import annotations

import csv
import json
import os
import shutil
import sqlite3
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from distributions import gesture, make_distribution

from gesture_core.cli.explain import _print_examples
from gesture_core.cli.main import run as run_command

pytestmark = pytest.mark.usefixtures("in_this_process")

_LENGTHS = {"A": 30, "B": 36, "C": 42}


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """<label>/<label>_<subject>.npy of three gestures by three subjects."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "classify"))
    from swings import swing

    folder = tmp_path_factory.mktemp("archive")
    for label, (joint, axis) in {
        "up": ("right_wrist", 1),
        "side": ("right_wrist", 0),
        "knee": ("left_knee", 1),
    }.items():
        for subject, frames in _LENGTHS.items():
            points = swing(joint, axis, 1.0, frames)
            stacked = np.concatenate([points + 300, np.ones((*points.shape[:2], 1))], axis=2)
            (folder / label).mkdir(exist_ok=True)
            np.save(folder / label / f"{label}_{subject}.npy", stacked)
    return folder


def run(words: list[str]) -> int:
    """Run a command as on a terminal, where it says text."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.stdout, "isatty", lambda: True)
        patch.setenv("COLUMNS", "240")
        return run_command(words)


def test_evaluate_prints_and_saves_everything(
    archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["evaluate", str(archive), "--subjects", "_([A-Z])", "--out", str(tmp_path)]
    assert run([*arguments, "--preset", "paper", "--grid", "t_var=0.01,0.05"]) == 0
    said = capsys.readouterr().out
    assert "leave-one-subject-out: 9 of 9 right, 100.0%" in said
    assert "chosen inside the training subjects of each fold" in said
    assert "recall" in said and "coverage" in said and "t_var" in said
    tree = json.loads((tmp_path / "evaluation.json").read_text())
    assert (tree["right"], tree["tested"], tree["accuracy"]) == (9, 9, 1.0)
    assert tree["confusion"]["counts"] == [[3, 0, 0], [0, 3, 0], [0, 0, 3]]
    assert len(tree["fingerprint"]) == 16
    rows = list(csv.DictReader((tmp_path / "answers.csv").open()))
    assert len(rows) == 9
    assert {row["predicted"] for row in rows} == {"up", "side", "knee"}
    for name in ("confusion.png", "rejection.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    assert run(["report", str(tmp_path)]) == 2
    assert "what gesture evaluate wrote: confusion.png" in capsys.readouterr().err


def test_evaluate_takes_labels_and_subjects_from_one_expression(
    archive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    labels = "(?P<label>[a-z]+)_(?P<subject>[A-Z])"
    assert (
        run(["evaluate", str(archive), "--labels", labels, "--preset", "modern", "--protocol", "donor"]) == 0
    )
    assert "donor: 18 of 18 right" in capsys.readouterr().out


def test_each_subject_may_have_a_folder(
    archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for clip in archive.rglob("*.npy"):
        label, _, subject = clip.stem.partition("_")
        (tmp_path / f"S{subject}" / "v1" / label).mkdir(parents=True)
        shutil.copy(clip, tmp_path / f"S{subject}" / "v1" / label)
    command = ["evaluate", str(tmp_path), "--labels", "folder:-1"]
    assert run(command) == 2
    assert "or folder:0 where each has a folder" in capsys.readouterr().err
    assert run([*command, "--subjects", "folder:0"]) == 0
    assert "leave-one-subject-out: 9 of 9 right" in capsys.readouterr().out
    assert run([*command, "--subjects", "folder:7"]) == 2
    assert "no subject for" in capsys.readouterr().err


def test_the_same_evaluation_has_the_same_fingerprint(archive: Path, tmp_path: Path) -> None:
    marks = []
    for index, extra in enumerate(([], [], ["--set", "gaussian.sigma=2"])):
        out = tmp_path / str(index)
        arguments = ["evaluate", str(archive), "--protocol", "leave-one-out", "--preset", "paper"]
        assert run([*arguments, "--set", "t_var=0.02", "--out", str(out), *extra]) == 0
        marks.append(json.loads((out / "evaluation.json").read_text())["fingerprint"])
    assert marks[0] == marks[1] != marks[2]


@pytest.mark.parametrize(
    ("extra", "code", "word"),
    [
        (["--protocol", "leave-one-subject-out"], 2, "E_SUBJECTS"),
        (["--subjects", "x(y)"], 2, "no subject for"),
        (["--subjects", "(("], 2, "no regular expression"),
        (["--subjects", "(x)?_"], 2, "no subject for"),
        (["--protocol", "split"], 2, "E_SPLIT"),
        (["--protocol", "dice"], 2, "one of leave-one-subject-out"),
        (["--grid", "t_var"], 2, "mirror=1.1,1.32"),
        (["--grid", "pose.height=256,368"], 2, "extracted once"),
        (["--protocol", "split", "--train", "(("], 2, "no regular expression"),
        (["--train", "_A"], 2, "--protocol split"),
    ],
)
def test_evaluate_refuses_with_a_remedy(
    archive: Path, extra: list[str], code: int, word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["evaluate", str(archive), *extra]) == code
    assert word in capsys.readouterr().err


def test_a_protocol_that_does_not_fit_is_refused_before_anything_is_extracted(
    archive: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def people_of(*_: object, **__: object) -> None:
        raise AssertionError("hours of work for nothing")

    monkeypatch.setattr("gesture_core.run.evaluate.people_of", people_of)
    few = ["--subjects", "_([A-Z])", "--protocol", "donor", "--grid", "neighbors=1,4"]
    for extra in (
        ["--protocol", "leave-one-subject-out"],
        ["--protocol", "split", "--train", "nothing"],
        few,
    ):
        assert run(["evaluate", str(archive), *extra]) == 2
    said = capsys.readouterr().err
    assert "E_SUBJECTS" in said and "E_SPLIT" in said
    assert "E_NEIGHBORS 4 neighbours were asked for, and a fold has 3 examples" in said


def test_without_matplotlib_only_the_pictures_are_missing(
    archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for module in (
        "matplotlib",
        "matplotlib.figure",
        "sklearn",
        "sklearn.metrics",
        "sklearn.model_selection",
    ):
        monkeypatch.setitem(sys.modules, module, None)
    chosen = ["--preset", "paper", "--set", "t_var=0.02"]
    assert run(["evaluate", str(archive), "--protocol", "leave-one-out", *chosen, "--out", "scores"]) == 0
    said = capsys.readouterr()
    assert "9 of 9 right" in said.out
    assert "no pictures: pictures need matplotlib; try: pip install 'gesture-core[evaluate]'" in said.err
    assert sorted(path.name for path in Path("scores").iterdir()) == ["answers.csv", "evaluation.json"]
    query = os.path.relpath(archive / "up" / "up_C.npy")
    assert run(["classify", query, "--examples", str(archive), "--out", "run", *chosen, "--quiet"]) == 0
    assert run(["explain", "run", "up_C.npy"]) == 0, "which is an example as well, under another name"
    said = capsys.readouterr()
    assert "answer     up" in said.out and "no picture: pictures need matplotlib" in said.err
    assert run(["explain", "run", "up_C.npy", "--out", "plot.png"]) == 1, "a picture was asked for"
    said = capsys.readouterr()
    assert "answer     up" in said.out and "E_MISSING_DEPENDENCY pictures need matplotlib" in said.err


def test_a_kernel_gets_its_options_for_the_fingerprint_too(archive: Path, tmp_path: Path) -> None:
    site = make_distribution(
        tmp_path / "site",
        "needy",
        """
        from gesture_core import hookimpl
        from gesture_dtw_numpy.kernel import NumpyKernel

        class Needy(NumpyKernel):
            def __init__(self, power): assert power == 2

        @hookimpl
        def register_distance_kernels(register):
            register("needy", "needy:Needy", summary="takes an option that it must have")
        """,
    )
    done = gesture(
        "evaluate", archive, "--protocol", "leave-one-out", "--kernel", "needy", "--set", "needy.power=2",
        "--preset", "paper", "--set", "t_var=0.02", "--out", tmp_path / "scores", path=site,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "fingerprint" in json.loads((tmp_path / "scores" / "evaluation.json").read_text())
    listed = gesture("plugins", "needy", path=site).stdout
    assert "needy.power" in listed and "(required)" in listed
    assert "model" not in gesture("plugins", "onnx").stdout.partition("option")[2].partition("to change")[0]


def test_what_cannot_be_used_counts_as_wrong_and_is_named(
    archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "archive"
    shutil.copytree(archive, folder)
    (folder / "up" / "up_D.npz").write_bytes(b"PK\x03\x04 no archive at all")
    (folder / "up" / "notes.md").write_text("neither")
    still = np.ones((30, 18, 3))
    still[..., :2] = 300
    np.save(folder / "up" / "up_E.npy", still)
    out = tmp_path / "out"
    arguments = ["evaluate", str(folder), "--protocol", "leave-one-out", "--preset", "paper"]
    assert run([*arguments, "--set", "t_var=0.02", "--out", str(out)]) == 3
    said = capsys.readouterr()
    assert "9 of 11 right" in said.out
    assert "recall" in said.out and "fold" not in said.out  # each fold is one input
    assert "left out as neither video nor keypoints: 1 file, " in said.err and "up/notes.md" in said.err
    assert "cannot be right" not in said.err
    assert "a stricter threshold labels fewer inputs (coverage)" in said.out
    assert "2 of 11 inputs count as not recognised" in said.err
    assert "assumed for 9 files: order=coco18, axes=xy, unit=pixels, fps=30" in said.err
    assert "--set says what is right: keypoints.order, keypoints.axes, keypoints.unit" in said.err
    assert "up_D.npz" in said.err and "up_E.npy" in said.err
    tree = json.loads((out / "evaluation.json").read_text())
    assert (tree["tested"], len(tree["not_recognised"])) == (11, 2)


def test_one_label_is_nothing_to_tell_apart(archive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    everything_alike = ["--labels", "(_)", "--protocol", "leave-one-out"]
    assert run(["evaluate", str(archive), *everything_alike]) == 2
    assert "E_LABELS every input is called '_': there is nothing to tell apart" in capsys.readouterr().err


def test_tests_that_must_fail_are_counted(archive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    subjects = [
        "--subjects",
        "_([A-Z])",
        "--labels",
        "^(side|knee|up_[AB]|up)",
    ]  # up, up_A and up_B: one each
    assert run(["evaluate", str(archive), *subjects, "--preset", "paper", "--set", "t_var=0.02"]) == 0
    said = capsys.readouterr()
    assert "3 of 9 tests cannot be right: no example of up, up_A, up_B is left to compare with" in said.err
    assert "6 of 9 right" in said.out


def test_half_a_name_is_no_subject(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("up/bén_1.avi", "side/bén_2.avi"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).touch()
    assert run(["evaluate", str(tmp_path), "--subjects", "([a-z]+)_"]) == 2
    assert "E_SUBJECTS --subjects '([a-z]+)_' finds 'n' inside a word of" in capsys.readouterr().err


def test_copies_are_said(archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "archive"
    shutil.copytree(archive, folder)
    shutil.copy(folder / "up" / "up_A.npy", folder / "up" / "up_F.npy")
    shutil.copy(folder / "up" / "up_B.npy", folder / "side" / "side_F.npy")
    arguments = ["--protocol", "leave-one-out", "--preset", "paper", "--set", "t_var=0.02"]
    assert run(["evaluate", str(folder), *arguments]) == 0
    said = capsys.readouterr().err
    assert "4 inputs move exactly as others do: they find their copies" in said
    (wrong,) = (line for line in said.splitlines() if "is called" in line)
    assert "side_F.npy is called side, and its copy " in wrong and wrong.endswith("up_B.npy up")


def test_a_classifier_that_learns_is_not_explained_by_distances(capsys: pytest.CaptureFixture[str]) -> None:
    side = SimpleNamespace(label="up")
    found = SimpleNamespace(nearest=side, runner_up=side, contributions=(), members=(), lead=0.5)
    _print_examples(found, "learner")  # type: ignore[arg-type]
    assert "'learner' decides by what it has learned, not by these distances" in capsys.readouterr().out
    found.lead = 0.0
    _print_examples(found, "nearest")  # type: ignore[arg-type]
    assert capsys.readouterr().out == ""


def test_explain_says_why(
    archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    queries = [os.path.relpath(path) for path in sorted(archive.glob("*/*_C.npy"))]
    Path("twin").mkdir()
    shutil.copy(queries[0], Path("twin") / Path(queries[0]).name)
    Path("notes.md").touch()
    np.save("short.npy", np.ones((2, 18, 3)))
    queries += ["twin", "notes.md", "short.npy"]
    examples = tmp_path / "examples"
    for path in archive.glob("*/*_A.npy"):
        (examples / path.parent.name).mkdir(parents=True)
        (examples / path.parent.name / path.name).write_bytes(path.read_bytes())
    chosen = ["--preset", "paper", "--set", "t_var=0.02"]
    assert run(["classify", *queries, "--examples", "examples", "--out", "run", *chosen, "--quiet"]) == 0
    capsys.readouterr()
    assert run(["explain", "run", "up_C.npy"]) == 0
    said = capsys.readouterr()
    assert "up (ok)" in said.out
    assert "answer     up" in said.out
    assert "right_wrist_y" in said.out
    plot = Path("run/explain-up_C.npy.png")
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert str(plot) in said.err
    database = sqlite3.connect("run/run.db")
    with database:
        database.execute("UPDATE rows SET label = 'other' WHERE input LIKE '%up_C.npy'")
    database.close()
    assert run(["explain", "run", "up_"]) == 0, "a part of the name is enough where only one has it"
    assert "the run gave the label other, this version gives up" in capsys.readouterr().out
    for wrong, hint in (
        (["nobody.npy"], "no input of the run is 'nobody.npy'"),
        (["C.npy"], "could be any of 4 inputs"),
        (["up_C.npy", "--person", "3"], "has no person 3; try: --person 0"),
        (["up_C.npy", "--out", "plot.txt"], "ends in .png"),
    ):
        assert run(["explain", "run", *wrong]) == 2
        assert hint in capsys.readouterr().err
    for name, why in (
        (
            "notes.md",
            "E_NOT_FOUND notes.md: there is nothing to explain, skipped E_NOT_AN_INPUT: is empty, 0 bytes",
        ),
        ("short.npy", "E_NOT_FOUND short.npy: there is nothing to explain, rejected E_POSE_SHORT: "),
    ):
        assert run(["explain", "run", name]) == 2
        error = capsys.readouterr().err
        assert why in error and error.count(name) == 1
    assert run(["explain", "run", "twin/knee_C.npy"]) == 0
    assert Path("run/explain-twin_knee_C.npy.png").is_file(), (
        "another clip of this name has a plot of its own"
    )
    capsys.readouterr()
    assert run(["explain", str(examples), "up_C.npy"]) == 2
    monkeypatch.chdir("/")
    assert run(["explain", str(tmp_path / "run"), "up_C.npy"]) == 0, "a run is explained from any folder"
    monkeypatch.chdir(tmp_path)
    changed = next(tmp_path.rglob("twin/knee_C.npy"))
    changed.write_bytes((archive / "up" / "up_B.npy").read_bytes())
    assert run(["explain", "run", "twin/knee_C.npy"]) == 1
    assert "has changed since the run" in capsys.readouterr().err
    # What is fitted belongs to the run folder: the examples may be gone, the input may not.
    shutil.rmtree(examples)
    assert run(["explain", "run", "up_C.npy"]) == 0
    assert "examples/up/up_A.npy" in capsys.readouterr().out
    Path("run/run.fitted").write_bytes(b"damaged")
    assert run(["explain", "run", "up_C.npy"]) == 2, "it is fitted again, of examples that are not there"
    assert "is not where the run found it" in capsys.readouterr().err


def test_left_and_right_of_one_name_are_said_by_every_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "classify"))
    from swings import swing

    for label, joint in {"swipe-left": "left_wrist", "swipe-right": "right_wrist", "up": "left_knee"}.items():
        for number, frames in enumerate(_LENGTHS.values()):
            points = swing(joint, 1, 1.0, frames)
            stacked = np.concatenate([points + 300, np.ones((*points.shape[:2], 1))], axis=2)
            (tmp_path / "clips" / label).mkdir(parents=True, exist_ok=True)
            np.save(tmp_path / "clips" / label / f"{number}.npy", stacked)
    clips, out = str(tmp_path / "clips"), str(tmp_path / "run")
    plain = ["--preset", "paper", "--kernel", "numpy", "--set", "classify.mirror=1.1"]
    for command in (
        ["evaluate", clips, "--protocol", "leave-one-out", *plain],
        ["classify", clips, "--examples", clips, "--out", out, "--engine", "inline", *plain],
        ["explain", out, "up/0", "--out", str(tmp_path / "up")],
    ):
        capsys.readouterr()
        assert run(command) == 0, command
        assert "'swipe-left' and the like on the right may be one gesture" in capsys.readouterr().err
    assert (tmp_path / "up.png").is_file(), "--out without a suffix is a picture all the same"
