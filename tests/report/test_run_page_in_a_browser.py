"""The page in a real browser, from disk: it draws, filters, sorts, plays, and asks nobody for anything."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import axe, browser, complaints, requested, resize
from test_run_page import HOSTILE, classified, page, rows_of

pytestmark = pytest.mark.usefixtures("in_this_process")

__all__ = ["classified", "page"]
NAMES = "return [...document.querySelectorAll('#body tr[data-index] .file')].map((one) => one.textContent)"


@pytest.fixture(scope="module")
def driver() -> Iterator[Any]:
    with browser() as opened:
        yield opened


@pytest.fixture
def opened(driver: Any, page: Path) -> Any:
    resize(driver, 1280, 2400)
    driver.get((page / "index.html").as_uri())
    return driver


def wait(driver: Any, condition: str) -> None:
    """Until a condition in JavaScript holds; ten seconds at most."""
    end = time.monotonic() + 10
    while not driver.execute_script(f"return Boolean({condition})"):
        assert time.monotonic() < end, condition
        time.sleep(0.05)


def press(driver: Any, key: str) -> None:
    event = "new KeyboardEvent('keydown', {key: arguments[0], bubbles: true})"
    driver.execute_script(f"document.activeElement.dispatchEvent({event})", key)


def test_rows_are_drawn_and_a_hostile_name_is_text(opened: Any, page: Path) -> None:
    names = opened.execute_script(NAMES)
    assert len(names) == len(rows_of(page)) and HOSTILE in names
    assert not opened.execute_script("return document.querySelectorAll('img, iframe, object').length")
    assert complaints(opened) == []


def test_the_least_certain_come_first_and_a_heading_turns_that_round(opened: Any, page: Path) -> None:
    def margins() -> list[float]:
        script = "return [...document.querySelectorAll('#body .c-sure .value')].map((one) => one.textContent)"
        return [float(text) for text in opened.execute_script(script) if text != "–"]

    known = sorted(row["margin"] for row in rows_of(page) if row["margin"] is not None)
    assert margins() == pytest.approx(known, abs=0.001)
    opened.execute_script("document.querySelector('#h-sure').click()")
    assert margins() == pytest.approx(known[::-1], abs=0.001)
    assert opened.execute_script("return document.querySelector('th.c-sure').ariaSort") == "descending"


def test_filters_choose_rows_by_label_text_status_and_cell(opened: Any, page: Path) -> None:
    shown = rows_of(page)
    label = next(row["label"] for row in shown if row["label"])
    some = {row["input"].rpartition("/")[2] for row in shown if row["label"] == label}
    field = "const one = document.querySelector(arguments[0]); one.value = arguments[1];"
    opened.execute_script(field + "one.dispatchEvent(new Event('change'))", "#f-label", label)
    assert set(opened.execute_script(NAMES)) == some
    press(opened, "Escape")
    assert len(opened.execute_script(NAMES)) == len(shown)
    opened.execute_script(field + "one.dispatchEvent(new Event('input'))", "#f-text", "ONERROR")
    wait(opened, "document.querySelectorAll('#body tr[data-index]').length === 1")
    press(opened, "Escape")
    opened.execute_script("document.querySelector('.chip.error').click()")
    assert opened.execute_script(NAMES) == ["broken.mp4"]
    press(opened, "Escape")
    opened.execute_script("document.querySelector('.cell.right').click()")
    assert len(opened.execute_script(NAMES)) == 2, "of each gesture there are two clips"
    assert "performed:" in opened.execute_script("return document.querySelector('#count').textContent")


def test_keys_choose_a_row_and_all_three_clips_play_at_its_time(opened: Any) -> None:
    first = opened.execute_script("return document.querySelector('#stage .path').textContent")
    press(opened, "ArrowDown")
    assert opened.execute_script("return document.querySelector('#stage .path').textContent") != first
    assert opened.execute_script("return document.querySelectorAll('[aria-selected=true]').length") == 1
    wait(opened, "document.querySelectorAll('#stage .panel video').length === 3")
    wait(opened, "[...document.querySelectorAll('#stage .panel video')].every((one) => one.readyState >= 2)")
    wait(opened, "document.querySelector('#stage .panel video').currentTime > 0.1")
    press(opened, " ")
    wait(opened, "gesture.player.paused && document.querySelector('#stage .panel video').paused")
    wanted = opened.execute_async_script("""
        const done = arguments[0], row = gesture.state.chosen;
        gesture.detail(row).then((record) => {
          const middle = row.seconds / 2;
          gesture.player.seek(middle);
          setTimeout(() => done([
            gesture.player.warp(record.time, record.near.time, 1000 * middle) / 1000,
            document.querySelector('#stage .near video').currentTime]), 1500);
        });""")
    assert wanted[0] == pytest.approx(wanted[1], abs=0.05)
    press(opened, "a")
    wait(opened, "document.querySelectorAll('#stage .film').length === 3")
    assert opened.execute_script("return document.querySelectorAll('#stage .channel').length") >= 1
    feet = opened.execute_script("""
        const grid = document.querySelector('#stage .channels');
        grid.append(grid.firstChild.cloneNode(true));
        grid.style.gridTemplateColumns = 'repeat(2, 1fr)';
        grid.firstChild.querySelector('figcaption').append(' and so on'.repeat(30));
        const charts = [grid.firstChild, grid.children[1]].map((one) => one.querySelector('svg'));
        return charts.map((one) => one.getBoundingClientRect().bottom);""")
    assert feet[0] == pytest.approx(feet[1], abs=1), "a long caption pushes no chart down"
    assert complaints(opened) == []


def test_rows_without_pictures_are_low(opened: Any) -> None:
    high = opened.execute_script("""
        const before = document.querySelector('#body tr[data-index]').offsetHeight;
        document.body.classList.add('unpictured');
        dispatchEvent(new Event('resize'));
        const after = document.querySelector('#body tr[data-index]').offsetHeight;
        document.body.classList.remove('unpictured');
        dispatchEvent(new Event('resize'));
        return [before, after];""")
    assert high[1] < high[0]


def test_the_threshold_says_what_it_keeps_and_what_to_type(opened: Any, page: Path) -> None:
    rows = [row for row in rows_of(page) if row["margin"] is not None]
    opened.execute_script("""
        const slider = document.querySelector('.slider');
        slider.value = 900; slider.dispatchEvent(new Event('input'));""")
    kept = sum(row["margin"] >= 0.9 for row in rows)
    odd = "gesture.rows.filter((row) => row.distance !== null && (row.label !== null) !== "
    odd += "gesture.keeps(row, {by: 'distance', value: gesture.limits.distance}))"
    assert opened.execute_script(f"return [gesture.limits.distance > 0, {odd}]") == [True, []]
    assert opened.execute_script("return document.querySelector('.setting').textContent") == (
        "--set classify.margin=0.900"
    )
    assert opened.execute_script("return document.querySelector('.said').textContent").startswith(
        f"{kept} row"
    )


def test_a_trial_gives_no_label_that_another_limit_of_the_run_refuses(opened: Any) -> None:
    keeps = """
        const {data, keeps} = gesture, own = {...data};
        const row = {best: "a", label: null, code: "E_REJECTED", distance: 0.9, score: arguments[2]};
        try {
            Object.assign(data, {reject: arguments[0], min_score: arguments[1]});
            return keeps(row, {by: "distance", value: 2});
        } finally { Object.assign(data, own); }"""
    cases = {(0.5, None, None): True, (0.5, 0.2, 0.3): True, (0.5, 0.2, 0.1): False, (None, 0.2, 0.1): False}
    assert {case: opened.execute_script(keeps, *case) for case in cases} == cases


@pytest.mark.parametrize("width", [360, 768, 1280, 2560])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_every_width(opened: Any, width: int, scheme: str) -> None:
    resize(opened, width, scheme=scheme)
    wait(opened, "document.querySelectorAll('#body tr[data-index]').length > 0")
    assert opened.execute_script("return document.documentElement.scrollWidth") <= width
    ground = opened.execute_script("return getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(18, 20, 22)") == (scheme == "dark")
    if width == 360:
        opened.execute_script("document.querySelector('#body tr[data-index]').click()")
        box = opened.execute_script(
            "return document.querySelector('#stage').getBoundingClientRect().toJSON()"
        )
        assert (box["left"], box["width"]) == (0, 360), "the chosen row covers a small screen"
        press(opened, "Escape")
        assert (
            opened.execute_script("return getComputedStyle(document.querySelector('#stage')).display")
            == "none"
        )


def test_many_rows_are_drawn_only_as_they_come_into_view(opened: Any) -> None:
    resize(opened, 1280)
    drawn = opened.execute_script("""
        const some = gesture.rows.slice();
        for (let index = some.length; index < 10000; index++)
          gesture.rows.push({...some[index % some.length], index});
        gesture.show();
        return [gesture.state.shown.length, document.querySelectorAll('#body tr[data-index]').length];""")
    assert drawn[0] == 10_000 and drawn[1] < 60
    stills = "[...document.querySelectorAll('#body video')].map((one) => one.getAttribute('poster'))"
    assert all(one.endswith(".jpg") for one in opened.execute_script(f"return {stills}"))
    printed = opened.execute_script("""
        gesture.show({text: gesture.rows[0].file});
        dispatchEvent(new Event('beforeprint'));
        const all = [gesture.state.shown.length, document.querySelectorAll('#body tr[data-index]').length];
        dispatchEvent(new Event('afterprint'));
        gesture.show({text: ''});
        return all;""")
    assert printed[0] == printed[1] > 600, "a printer has every row"
    opened.execute_script("scrollTo(0, document.body.scrollHeight)")
    wait(opened, "document.querySelector('#body tr[aria-rowindex=\"10001\"]')")
    assert opened.execute_script("return document.querySelectorAll('#body tr[data-index]').length") < 60


def test_nothing_leaves_the_page(opened: Any, page: Path) -> None:
    press(opened, "ArrowDown")
    press(opened, "a")
    wait(opened, "document.querySelectorAll('#stage .film').length === 3")
    asked = requested(opened)
    assert len(asked) > 10
    assert {one for one in asked if not one.startswith(("file://", "data:"))} == set()


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (1280, "dark"), (360, "light")])
def test_axe_finds_nothing_serious(opened: Any, width: int, scheme: str, tmp_path: Path) -> None:
    source = axe(tmp_path)
    resize(opened, width, scheme=scheme)
    wait(opened, "document.querySelectorAll('#body tr[data-index]').length > 0")
    opened.execute_script("document.querySelector('#body tr[data-index]').click(); gesture.stage.toggle()")
    wait(opened, "document.querySelectorAll('#stage .film').length === 3")
    opened.execute_script(source)
    found = opened.execute_async_script(
        "axe.run().then(arguments[0], (error) => arguments[0]({error: String(error)}))"
    )
    serious = [
        (one["id"], [node["html"][:120] for node in one["nodes"][:3]])
        for one in found["violations"]
        if one["impact"] in ("serious", "critical")
    ]
    assert serious == []


def test_it_prints_in_light_colours_and_with_every_row(opened: Any, page: Path) -> None:
    resize(opened, 1000, scheme="dark")
    features = [{"name": "prefers-color-scheme", "value": "dark"}]
    opened.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print", "features": features})
    try:
        style = (
            "const style = getComputedStyle(document.querySelector(arguments[0])); return style[arguments[1]]"
        )
        assert opened.execute_script(style, "html", "colorScheme") == "light"
        ground, ink = (opened.execute_script(style, "body", name) for name in ("backgroundColor", "color"))
        assert ground == "rgb(255, 255, 255)" and max(map(int, re.findall(r"\d+", ink)[:3])) < 100
        assert opened.execute_script(style, ".filters", "display") == "none"
        opened.execute_script("dispatchEvent(new Event('beforeprint'))")
        printed = (
            "return [...document.querySelectorAll('#body tr[data-index]')].map((one) => one.textContent)"
        )
        texts = opened.execute_script(printed)
        assert len(texts) == len(rows_of(page)) and any(HOSTILE in text for text in texts)
    finally:
        opened.execute_script("dispatchEvent(new Event('afterprint'))")
        opened.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
