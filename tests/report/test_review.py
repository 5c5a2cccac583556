"""Answers of a person: one key each, kept beside the machine's, for nobody but who opened the page."""

from __future__ import annotations

import csv
import http.client
import json
import os
import shutil
import socket
import sqlite3
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import browser, complaints, requested, resize
from test_run_page import classified

from gesture_core.cli.main import run
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import InputError
from gesture_core.report.review_server import ReviewServer
from gesture_core.report.run_page import write_report
from gesture_core.run.archive import classify_archive, load_poses
from gesture_core.run.results import FITTED, open_results
from gesture_core.run.review import NONE, Answered, Answers, add_corrections, choose, write_answers
from gesture_core.run.store import write_keypoints
from gesture_core.run.tables import read_labels, read_manifest

pytestmark = pytest.mark.usefixtures("in_this_process")

__all__ = ["classified"]
FACTS: dict[str, Any] = {
    "frames_declared": None, "frames_read": 2, "frames_looked_at": 2, "complete": True, "notes": [],
    "seconds": 1.0, "assumed": "",
}  # fmt: skip


@pytest.fixture
def copy(classified: tuple[Path, Path], tmp_path: Path) -> Path:
    """A run of its own, as answers change it."""
    return Path(shutil.copytree(classified[0], tmp_path / "run"))


@pytest.fixture
def server(copy: Path) -> Iterator[ReviewServer]:
    done = write_report(copy, previews=False)
    with Answers(copy) as answers, ReviewServer(answers) as opened:
        opened.show(done.page.parent, done.labels)
        thread = threading.Thread(target=opened.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        yield opened
        opened.shutdown()


def ask(
    server: ReviewServer, method: str, path: str, body: Any = None, **headers: str
) -> tuple[int, bytes, dict[str, str]]:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    sent = {"Content-Type": "application/json"} if body is not None else {}
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    text = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
    connection.request(method, path, text, sent | named)
    reply = connection.getresponse()
    found = reply.status, reply.read(), dict(reply.headers)
    connection.close()
    return found


def test_an_answer_is_kept_in_a_table_of_its_own(copy: Path) -> None:
    with open_results(copy) as results:
        before = list(results.rows())
    with Answers(copy) as answers:
        answers.give(1, "wave")
        answers.give(2, None)
        answers.give(3, "clap")
        answers.take_back(3)
        answers.give(1, "flap")
    with Answers(copy) as answers:
        assert answers.given() == {1: "flap", 2: None}
        assert [(one.row, one.label) for one in answers.answered()] == [
            (before[1], "flap"),
            (before[2], None),
        ]
    with open_results(copy) as results:
        assert list(results.rows()) == before, "never over the machine's"


def test_answers_are_a_table_of_paths_and_labels(copy: Path, tmp_path: Path) -> None:
    table = tmp_path / "corrected.csv"
    assert run(["review", str(copy), "--export", str(table)]) == 2, "nothing was answered"
    with Answers(copy) as answers:
        answers.give(1, "wave")
        answers.give(2, None)
        rows = [row for _, row in answers.rows]
        write_answers(answers.answered(), table)
    with table.open(newline="", encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    assert [(row["path"], row["label"]) for row in found] == [(rows[1].input, "wave"), (rows[2].input, NONE)]
    assert [row["recognised_as"] for row in found] == [rows[1].label or "", rows[2].label or ""]


def test_the_label_of_a_part_is_not_that_of_all_of_the_input(
    copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    database = sqlite3.connect(copy / "run.db")
    with database:
        database.execute("UPDATE rows SET event = 1, start = 1.5, end = 2.5 WHERE input LIKE '%clip_03'")
        database.execute("UPDATE rows SET person = 1 WHERE input LIKE '%clip_04'")
    database.close()
    with Answers(copy) as answers:
        names = [Path(row.input).name for _, row in answers.rows]
        for name in ("clip_02", "clip_03", "clip_04"):
            answers.give(names.index(name), "wave")
        place = answers.rows[names.index("clip_02")][1].input
    assert run(["review", str(copy), "--export", str(tmp_path / "corrected.csv")]) == 0
    assert read_manifest(tmp_path / "corrected.csv") == [(Path(place), "wave")]
    assert read_labels(tmp_path / "corrected.csv") == ([(place, "wave")], True)
    assert "2 about an event" in capsys.readouterr().err
    with (tmp_path / "corrected.csv").open(newline="", encoding="utf-8") as file:
        assert [Path(row["input"]).name for row in csv.DictReader(file)] == ["clip_02", "clip_03", "clip_04"]


def test_a_name_that_is_no_text_is_written_byte_by_byte_and_read_again(copy: Path, tmp_path: Path) -> None:
    with Answers(copy) as answers:
        row = answers.rows[1][1]
    name = tmp_path / os.fsdecode(b"b\xff'\"%,x.mp4")
    table = write_answers([Answered(os.fsencode(name) + b"\0", row, "wave")], tmp_path / "corrected.csv")
    assert read_manifest(table) == [(name, "wave")]


def test_only_who_knows_the_address_is_answered(server: ReviewServer) -> None:
    secret = f"/{server.token}/"
    status, body, headers = ask(server, "GET", secret)
    assert status == 200 and b"<title>" in body and "no-store" in headers["Cache-Control"]
    for path in ("/", "/index.html", "/wrong/", f"/{server.token[:-1]}/", "/../run.db"):
        assert ask(server, "GET", path)[0] == 404, path
    for name in ("../run.db", "..%2frun.db", "clips/../../run.db", "/etc/passwd", "answers", "run.db"):
        assert ask(server, "GET", secret + name)[0] == 404, name
    for host in ("evil.example", f"evil.example:{server.server_port}", "127.0.0.1", ""):
        assert ask(server, "GET", secret, Host=host)[0] == 403, host
    assert ask(server, "GET", secret, Host=f"localhost:{server.server_port}")[0] == 200


def test_an_address_that_is_none_is_refused_like_any_other(
    server: ReviewServer, capfd: pytest.CaptureFixture[str]
) -> None:
    for path in ("http://[x/", f"//[{server.token}/", "*", f"/{server.token}/../index.html", "/\u00e9/"):
        with socket.create_connection(("127.0.0.1", server.server_port), timeout=10) as opened:
            asked = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{server.server_port}\r\n\r\n"
            opened.sendall(asked.encode("latin-1"))
            assert opened.recv(100).startswith(b"HTTP/1.1 404 "), path
    assert capfd.readouterr().err == ""


def test_an_answer_comes_from_the_page_itself_and_is_one(server: ReviewServer) -> None:
    path, good = f"/{server.token}/answers", {"row": 1, "label": "wave"}
    assert ask(server, "POST", path, good, Origin="http://evil.example")[0] == 403
    assert ask(server, "POST", path, good, Origin="null")[0] == 403
    assert ask(server, "POST", path, good, Content_Type="text/plain")[0] == 403
    assert ask(server, "POST", f"/{'x' * 32}/answers", good)[0] == 404
    wrong: list[Any] = [{"row": 99}, {"row": True}, [], {"label": 3}]
    wrong += [{"row": 1, "label": label} for label in (3, "", " wave", "a\nb", "\ud800", "x" * 201)]
    for bad in wrong:
        assert ask(server, "POST", path, bad)[0] == 400, bad
    assert ask(server, "POST", path, b"{")[0] == 400
    assert ask(server, "POST", path, b" " * 5000)[0] == 413
    assert server.answers.given() == {}
    own = f"http://127.0.0.1:{server.server_port}"
    assert ask(server, "POST", path, good, Origin=own)[0] == 204
    assert ask(server, "POST", path, {"row": 2, "label": None})[0] == 204
    assert server.answers.given() == {1: "wave", 2: None}
    data = ask(server, "GET", f"/{server.token}/data.js")[1]
    assert b'gestureData.review={"answers": [[1, "wave"], [2, null]]}' in data
    assert ask(server, "POST", path, {"row": 2, "forget": True})[0] == 204
    assert server.answers.given() == {1: "wave"}


def test_a_port_in_use_is_noticed_before_a_page_is_made(
    server: ReviewServer, classified: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["review", str(classified[0]), "--port", str(server.server_port)]) == 2
    assert f"--port {server.server_port} cannot be had" in capsys.readouterr().err
    assert not (classified[0] / "review").exists()


def test_a_label_that_no_example_has_is_an_answer(server: ReviewServer, tmp_path: Path) -> None:
    path = f"/{server.token}/answers"
    markup = "<img src=x onerror=alert(1)>"
    for row, label in enumerate(["thumbs up", markup, "\N{WAVING HAND SIGN} 挥手", NONE]):
        assert ask(server, "POST", path, {"row": row, "label": label})[0] == 204
    assert server.answers.given() == {0: "thumbs up", 1: markup, 2: "\N{WAVING HAND SIGN} 挥手", 3: None}
    data = ask(server, "GET", f"/{server.token}/data.js")[1]
    assert markup.encode() not in data and b"thumbs up" in data
    table = write_answers(server.answers.answered(), tmp_path / "corrected.csv")
    assert {label for _, label in read_labels(table)[0]} >= {"thumbs up", "\N{WAVING HAND SIGN} 挥手"}


def test_a_part_of_a_file_is_sent_to_a_player(server: ReviewServer) -> None:
    whole = ask(server, "GET", f"/{server.token}/page.css")[1]
    status, part, headers = ask(server, "GET", f"/{server.token}/page.css", Range="bytes=10-19")
    assert (status, part) == (206, whole[10:20])
    assert headers["Content-Range"] == f"bytes 10-19/{len(whole)}"
    assert ask(server, "GET", f"/{server.token}/page.css", Range=f"bytes={len(whole)}-")[0] == 416


def test_a_key_a_clip_and_the_next_one_is_there(server: ReviewServer) -> None:
    keys = pytest.importorskip("selenium.webdriver.common.keys", reason="selenium is not installed")
    with browser() as driver:
        resize(driver, 1280, 900)
        driver.get(server.address)
        wait(driver, "document.querySelector('#stage .review')")
        foot = "Math.max(...[...document.querySelectorAll('.answer-button')].map((one) => "
        foot += "one.getBoundingClientRect().bottom))"
        assert driver.execute_script(f"return {foot}") < 900, "what a person needs is seen at once"
        order = driver.execute_script("return gesture.state.shown.map((row) => row.index)")
        names = driver.execute_script("return gesture.state.shown.map((row) => row.best)")
        press(driver, "Enter")
        press(driver, "0")
        press(driver, "2")
        wait(driver, "gesture.state.answers.size === 3")
        assert driver.execute_script("return gesture.state.chosen.index") == order[3]
        until(lambda: len(server.answers.given()) == 3)
        second = sorted(server.labels)[1]
        assert server.answers.given() == {order[0]: names[0], order[1]: None, order[2]: second}
        press(driver, "Backspace")
        until(lambda: len(server.answers.given()) == 2)
        press(driver, "+")
        wait(driver, "document.activeElement.matches('#stage .another input')")
        typing = driver.switch_to.active_element
        typing.send_keys("2j a <b>", keys.Keys.ENTER)
        until(lambda: server.answers.given().get(order[2]) == "2j a <b>")
        press(driver, "?")
        listed = driver.execute_script("return document.getElementById('keys').textContent")
        assert listed.endswith("2j a <b>"), "a label has its key in the list as soon as it has one"
        driver.execute_script("document.getElementById('help').close()")
        assert driver.execute_script("return gesture.state.chosen.index") == order[3]
        made = "[...document.querySelectorAll('#stage .answer-button')].find((one) => /2j a <b>$/.test("
        made += "one.textContent))"
        press(driver, driver.execute_script(f"return {made}.querySelector('kbd').textContent"))
        until(lambda: server.answers.given().get(order[3]) == "2j a <b>")
        driver.get(server.address)
        wait(driver, "document.querySelectorAll('#body .answer').length === 4")
        wait(driver, made)
        assert complaints(driver) == []
        assert {one for one in requested(driver) if not one.startswith((server.address, "data:"))} == set()


def wait(driver: Any, condition: str) -> None:
    until(lambda: bool(driver.execute_script(f"return Boolean({condition})")))


def until(condition: Any) -> None:
    end = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def press(driver: Any, key: str) -> None:
    event = "new KeyboardEvent('keydown', {key: arguments[0], bubbles: true})"
    driver.execute_script(f"document.activeElement.dispatchEvent({event})", key)


def test_clips_that_change_most_decisions_come_first_and_known_ones_not_at_all() -> None:
    known = np.array([[1.0, 9], [2, 9], [2, 9], [9, 1], [3, 9]])
    new = np.array([[5.0, 0, 9], [0.5, 1, 9], [0.4, 3, 9], [9, 9, 0], [9, 0.1, 9]])
    # The first changes rows 1 and 2, the second rows 0, 1 and 4; what the third says, row 3 has already.
    said = ["a", "a", "a", "b", "a"]
    assert choose(known, said, new, ["b", "b", "b"], [2, 4, 3]) == [1, 0]
    assert choose(known, said, new, ["b", "b", "b"], [2, 4, 3], most=1) == [1]
    assert choose(known, said, new[:, :1], ["a"], [0]) == []
    # What the run has wrong is no example's fault alone: it counts what the run says, not what is nearest.
    assert choose(known, ["b", *said[1:]], new[:, :1], ["a"], [0]) == [0]


def test_a_correction_becomes_an_example_and_the_next_run_knows_it(
    classified: tuple[Path, Path], copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with open_results(copy) as results:
        rows = list(results.rows())
    place = next(place for place, row in enumerate(rows) if row.label == "wave")
    right = next(place for place, row in enumerate(rows) if row.label == "clap")
    with Answers(copy) as answers:
        answers.give(place, "swipe")
        answers.give(right, "clap")
        answers.give(next(i for i, row in enumerate(rows) if row.label == "flap"), None)
    found = add_corrections(copy, tmp_path / "examples")
    assert [path.parent.name for path in found.added] == ["swipe"]
    assert found.redundant == 1 and found.left_out == {"none of the gestures": 1}
    assert run(["review", str(copy), "--to-examples", str(tmp_path / "examples"), "--most", "1"]) == 0
    assert len(list((tmp_path / "examples" / "swipe").iterdir())) == 2, "what is there is not replaced"
    library = tmp_path / "library"
    for path in sorted((tmp_path / "examples" / "swipe").iterdir())[:1]:
        shutil.copytree(path, library / "swipe" / path.name)
    for one in known(classified):
        if one["label"] != "wave":
            shutil.copytree(one["path"], library / one["label"] / "1", dirs_exist_ok=True)
    again = classify_archive([rows[place].input, rows[right].input], library, tmp_path / "again")
    assert {row.input: row.label for row in again.rows()} == {
        rows[place].input: "swipe", rows[right].input: "clap",
    }  # fmt: skip
    with pytest.raises(InputError, match="nothing was answered"):
        add_corrections(classified[0], tmp_path / "other")


def test_answers_that_can_be_no_example_are_counted_by_their_reasons(
    classified: tuple[Path, Path], copy: Path, tmp_path: Path
) -> None:
    with open_results(copy) as results:
        place = next(place for place, row in enumerate(results.rows()) if row.label == "wave")
    for label in ("up/left", "..", "a\\b"):
        with Answers(copy) as answers:
            answers.give(place, label)
        found = add_corrections(copy, tmp_path / "examples")
        assert (found.added, *found.left_out.values()) == ((), 1) and "--export" in next(iter(found.left_out))
    (copy / FITTED).unlink()  # as in a run of gesture spot
    with Answers(copy) as answers:
        answers.give(place, None)
    assert add_corrections(copy, tmp_path / "examples").left_out == {"none of the gestures": 1}
    assert not (tmp_path / "examples").exists()


def known(classified: tuple[Path, Path]) -> list[dict[str, str]]:
    """The examples of the run."""
    with open_results(classified[0]) as results:
        return list(json.loads(results.get("configuration") or "{}")["examples"].values())


def test_corrections_are_about_the_first_of_several_people(drawn: DemoArchive, tmp_path: Path) -> None:
    names = [drawn.video_keypoints / name for name in ("clip_01", "clip_02")]
    whole = [load_poses(name)[0] for name in names]
    brief = [
        replace(one, keypoints=one.keypoints[:2], scores=one.scores[:2], times=one.times[:2]) for one in whole
    ]
    (tmp_path / "in").mkdir()
    write_keypoints(tmp_path / "in" / "first.parquet", [whole[0], replace(brief[1], person=1)], FACTS)
    write_keypoints(tmp_path / "in" / "second.parquet", [brief[0], replace(whole[1], person=1)], FACTS)
    done = classify_archive(tmp_path / "in", drawn.example_keypoints, tmp_path / "run", pose__people="multi")
    assert [row.distance is None for row in done.rows()] == [False, True, True, False]
    label = done.rows()[0].label
    with Answers(tmp_path / "run") as answers:
        answers.give(0, label)
    assert add_corrections(tmp_path / "run", tmp_path / "examples").redundant == 1
    with Answers(tmp_path / "run") as answers:
        answers.give(0, "clap" if label != "clap" else "wave")
    (added,) = add_corrections(tmp_path / "run", tmp_path / "examples").added
    assert added.name == "first.parquet"
