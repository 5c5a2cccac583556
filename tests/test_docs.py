"""The documentation cannot rot: it builds strictly, its links lead somewhere, its code and commands run."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from dataclasses import fields
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from typing import get_args
from urllib.parse import unquote, urlsplit

import pytest
from conftest import ROOT
from pages import blocks, spoken_commands, table, write_folder

from gesture_core.cli.main import FLAGS_OF_EVERY_COMMAND, app, run
from gesture_core.demo.archive import DemoArchive
from gesture_core.demo.figure import GESTURES
from gesture_core.errors import Code, Status
from gesture_core.plugin.hooks import KINDS
from gesture_core.settings import LimitSettings, load_settings
from gesture_core.types import COLUMNS

DOCS = ROOT / "docs"
EVERY = sorted(DOCS.rglob("*.md"))
PAGES = [*sorted((DOCS / "start").glob("*.md")), *sorted((DOCS / "howto").glob("*.md"))]
TUTORIAL = DOCS / "howto" / "tutorial.md"
FETCHED = {
    "stylesheet",
    "icon",
    "preload",
    "prefetch",
    "preconnect",
    "dns-prefetch",
    "modulepreload",
    "manifest",
}


def page_name(page: Path) -> str:
    return page.relative_to(DOCS).as_posix()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The documentation, built strictly into a folder of its own."""
    for module in ("mkdocs", "material", "mkdocstrings"):
        if find_spec(module) is None:
            pytest.skip(f"{module} is not installed: pip install 'gesture-core[docs]'")
    place = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(place)]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return place


class Links(HTMLParser):
    """The anchors of a page, where it leads, and what it loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.targets: set[str] = set()
        self.loaded: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attributes}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        fetched = tag == "link" and FETCHED & set(given.get("rel", "").split())
        if "src" in given or fetched:
            self.loaded.add(given.get("src") or given["href"])
        if "href" in given and tag in ("a", "link"):
            self.targets.add(given["href"])


def test_it_builds_strictly_and_every_link_leads_somewhere(site: Path) -> None:
    found = {page: Links(page.read_text("utf-8")) for page in site.rglob("*.html") if page.name != "404.html"}
    assert len(found) > 30
    for page, links in found.items():
        for target in links.targets | links.loaded:
            where = urlsplit(target)
            if where.scheme in ("http", "https", "data"):
                continue
            there = (page.parent / unquote(where.path)).resolve() if where.path else page
            there = there / "index.html" if there.is_dir() else there
            assert there.is_file(), f"{page.relative_to(site)} leads to {target}"
            if where.fragment and there in found:
                assert unquote(where.fragment) in found[there].anchors | {"__toc", "__drawer", "__search"}, (
                    target
                )


def test_no_page_loads_anything_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        loaded = Links(page.read_text("utf-8")).loaded
        assert not [target for target in loaded if target.startswith(("http:", "https:", "//"))], page
    for sheet in site.rglob("*.css"):
        assert not re.search(r"(?:@import|url\()\s*[\"']?(?:https?:)?//", sheet.read_text("utf-8")), sheet


def test_the_generated_pages_are_complete(site: Path) -> None:
    settings = (site / "reference" / "settings" / "index.html").read_text("utf-8")
    ready = load_settings(environment={})
    for section in ("pose", "signals", "dtw", "classify", "limits"):
        for part in fields(getattr(ready, section)):
            assert f"<code>{section}.{part.name}</code>" in settings
    for name in ("howto/plugins", "reference/interfaces"):
        text = (site / name / "index.html").read_text("utf-8")
        for kind in KINDS.values():
            assert f"<code>{kind.hook}</code>" in text, (name, kind)
    commands = (site / "reference" / "commands" / "index.html").read_text("utf-8")
    for name in app:
        assert name.startswith("-") or f">gesture {name}<" in commands, name
    codes = (site / "reference" / "codes" / "index.html").read_text("utf-8")
    for code in Code:
        assert f"<code>{code.value}</code>" in codes


@pytest.mark.parametrize("page", EVERY, ids=page_name)
def test_paths_in_the_text_exist_and_pictures_are_small(page: Path) -> None:
    text = page.read_text("utf-8")
    for path in re.findall(r"`((?:gesture_core|plugins|tests|benchmarks|docs)/[\w./]+)`", text):
        assert (ROOT / path).exists(), path
    for path in re.findall(r"python (benchmarks/\w+\.py)", text):
        assert (ROOT / path).is_file(), path
    for picture in re.findall(r"!\[[^]]*\]\(([^)\s]+)\)", text):
        if "compact/" not in picture:  # the model card's, which the build brings
            assert (page.parent / picture).stat().st_size < 300_000, picture


@pytest.fixture(scope="module")
def folder(drawn: DemoArchive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the pages suppose."""
    return write_folder(drawn, tmp_path_factory.mktemp("docs"))


_DONE: set[str] = set()


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if page != TUTORIAL], ids=page_name)
@pytest.mark.usefixtures("in_this_process")
def test_the_commands_and_the_python_of_a_page_run(
    page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What needs a run folder gets that of the first page, as a reader who followed it has."""
    monkeypatch.chdir(folder)
    main_job = "gesture classify videos/ --examples examples/ --out run/"
    for block in blocks(page):
        for command in [main_job, *block.commands]:
            if command not in _DONE and not block.why:
                assert run(shlex.split(command)[1:]) == 0, (command, capsys.readouterr().err)
                _DONE.add(command)
        if block.kind == "python" and not block.why:
            exec(compile(block.text, page_name(page), "exec"), {})


@pytest.mark.parametrize("page", EVERY, ids=page_name)
def test_the_commands_of_a_page_are_understood(page: Path) -> None:
    shown = [command for block in blocks(page) for command in block.commands]
    for command in [*shown, *spoken_commands(page)]:
        words = [word.strip("[]").split("|")[0] for word in shlex.split(command)[1:]]
        words = [word for word in words if word not in FLAGS_OF_EVERY_COMMAND]
        if words[0].isupper() or "…" in words or words[0].startswith("-"):
            continue  # a form of commands is spoken of
        assert words[0] in app, command
        if len(words) > 1:
            app.parse_args(words, exit_on_error=False, print_error=False)


@pytest.mark.slow
def test_the_tutorial_goes_as_it_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What it shows of the template is the template, and its own code passes its own tests."""
    hooks, changed, test = (block.text for block in blocks(TUTORIAL) if block.kind == "python")
    shown = [block.text for block in blocks(TUTORIAL) if block.kind == "text"]
    assert run(["plugins", "new", "filter", "speed", "--out", str(tmp_path)]) == 0
    written = capsys.readouterr().out.replace(f"{tmp_path}/", "")
    assert written == shown[0]
    folder = tmp_path / "gesture-speed"
    assert (folder / "gesture_speed" / "hooks.py").read_text("utf-8") == hooks
    (folder / "gesture_speed" / "filter.py").write_text(changed, "utf-8")
    tests = folder / "tests" / "test_speed.py"
    tests.write_text(tests.read_text("utf-8") + "\n\n" + test, "utf-8")
    install = [
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--target",
        str(tmp_path / "site"),
    ]
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "site")}
    for command in ([*install, str(folder)], ["pytest", "-q", str(folder)]):
        words = [sys.executable, "-m", *command]
        done = subprocess.run(words, capture_output=True, text=True, env=environment, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    assert f"{shown[-1].split()[1]}" == "speed" and "9 passed" in done.stdout


def test_the_expression_for_labels_finds_the_gestures_of_the_demonstration() -> None:
    (expression,) = set(
        re.findall(r"--labels '([^']+)'", (DOCS / "howto" / "archives.md").read_text("utf-8"))
    )
    for label in GESTURES:
        assert re.search(expression, f"{label}_1.avi")["label"] == label  # type: ignore[index]


def test_the_preset_loads(tmp_path: Path) -> None:
    (text,) = (block.text for block in blocks(DOCS / "howto" / "accuracy.md") if block.kind == "toml")
    (tmp_path / "mine.toml").write_text(text)
    settings = load_settings(tmp_path / "mine.toml", environment={})
    assert settings.classify.reject == 0.5
    assert settings.options["resample"]["rate"] == 25.0


def test_the_tables_are_those_of_the_code() -> None:
    rows, trust = DOCS / "reference" / "rows.md", DOCS / "reference" / "trust.md"
    assert {cells[0].strip("`") for cells in table(rows, "status")} == set(get_args(Status))
    listed = [name for cells in table(rows, "column") for name in re.findall(r"\w+", cells[0])]
    assert listed == list(COLUMNS)
    defaults = LimitSettings()
    limits = {cells[0].strip("`").removeprefix("limits."): cells[1] for cells in table(trust, "setting")}
    assert set(limits) == {part.name for part in fields(defaults)}
    for name, value in limits.items():
        assert float(re.sub(r"[^0-9.]", "", value)) == getattr(defaults, name), name


def test_the_files_of_the_project_can_be_read() -> None:
    yaml = pytest.importorskip("yaml")
    for name in (
        "CITATION.cff",
        ".pre-commit-config.yaml",
        ".github/workflows/test.yml",
    ):
        assert yaml.safe_load((ROOT / name).read_text("utf-8")), name
    for name in ("bug", "feature"):
        _, head, _ = (ROOT / ".github" / "ISSUE_TEMPLATE" / f"{name}.md").read_text("utf-8").split("---\n")
        assert {"name", "about"} <= set(yaml.safe_load(head))
