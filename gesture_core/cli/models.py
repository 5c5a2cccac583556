"""``gesture models``: which pose networks there are, with hash and licence; fetching and adding others."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import cyclopts
from cyclopts import Parameter

from gesture_core.cli.flags import UNSAID
from gesture_core.cli.output import print_list
from gesture_core.errors import ModelError

if TYPE_CHECKING:
    from gesture_core.pose.models import ModelFile

app = cyclopts.App(
    name="models",
    help="List, get, add and verify pose networks.",
    help_format="plaintext",
    default_parameter=Parameter(negative=()),
)


@app.default
def list_models() -> int:
    """List the networks that are here, and the public ones that can be fetched or added."""
    from gesture_core.files import models_dir
    from gesture_core.pose.model_store import added_names, read_card
    from gesture_core.pose.models import find_model, known_models

    here: list[tuple[str, ...]] = []
    get: list[tuple[str, ...]] = []
    more: list[tuple[str, ...]] = []
    for name in added_names():
        try:
            card = read_card(name)
        except ModelError as error:
            here.append((name, f"broken: {error.cause}", "", "", "", "", str(models_dir() / name)))
            continue
        here.append((name, "added", *_facts(card), card.sha256, card.licence, str(card.path)))
    for known in known_models().values():
        if known.name in added_names():
            continue
        if known.packaged_path is not None:
            found = find_model(known.name)
            facts = (*_facts(found), found.sha256, known.licence, str(found.path))
            here.append((known.name, "packaged", *facts))
        elif known.member:
            get.append((known.name, "to get", known.summary, known.licence, known.wheel or known.url))
        else:
            where = "missing from this installation" if known.packaged else known.where
            more.append((known.name, "to add", known.summary, known.licence, where))
    if sys.stdout.isatty():  # a hash is as wide as a table; verify checks all of it
        here = [(*row[:4], row[4][:12], *row[5:]) for row in here]
    print_list(("name", "status", "output", "input", "sha256", "licence", "place"), here, below=True)
    columns = ("name", "status", "what it is", "licence", "place")
    if get:
        print_list(columns, get, below=True, title="Known, not here; bring it with: gesture models get NAME")
    if more:
        title = "Known, not here; bring the file with: gesture models add FILE"
        print_list(columns, more, below=True, title=title)
    return 0


app.command(list_models, name="list")


@app.command
def get(*names: Annotated[str, Parameter(required=True)], replace: Annotated[bool, UNSAID] = False) -> int:
    """Fetch known pose networks by name, from the package index of pip or by https, checked by their hashes.

    Parameters
    ----------
    names
        As 'gesture models' lists them: blazepose, rtmpose-s.
    replace
        Fetch what is here once more.
    """
    from gesture_core.files import printable
    from gesture_core.pose.downloads import get_model
    from gesture_core.skeletons import skeleton

    for name in names:
        with _bar() as on_bytes:
            card = get_model(name, replace=replace, on_bytes=on_bytes)
        facts = "  ".join(part for part in (*_facts(card), card.licence) if part)
        print(f"{card.name}: {printable(card.path)}\nsha256 {card.sha256}\n{facts}")
        if card.contract:
            found = skeleton(card.contract.skeleton)
            use = f"--model {name}" if found.has_neck else "--preset hands"
            if found.group("face") == found.joints:
                use += " --set keypoints.parts=body,hands,face --set hands.face=true"
            print(f"use it with: {use}")
    return 0


@contextmanager
def _bar() -> Iterator[Callable[[int], None]]:
    """Takes numbers of bytes that have arrived, and shows them in a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TransferSpeedColumn

    columns = ("downloading", BarColumn(), DownloadColumn(), TransferSpeedColumn())
    with Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("", total=None, visible=False)
        yield lambda count: bar.update(task, advance=count, visible=True)


@app.command
def add(
    source: str,
    /,
    *,
    name: Annotated[str, UNSAID] = "",
    sha256: Annotated[str, UNSAID] = "",
    licence: Annotated[str, UNSAID] = "",
    contract: Annotated[
        tuple[str, ...],
        Parameter(
            consume_multiple=False,
            show_default=False,
            help="Overrides what the file says, as key=value, such as colour=rgb or 'mean=[128, 128, 128]'; "
            "may be repeated.",
        ),
    ] = (),
    replace: Annotated[bool, UNSAID] = False,
) -> int:
    """Add a pose network from a file or an https address, under a name for --model.

    Parameters
    ----------
    source
        An .onnx, .tflite, .pb or .caffemodel file, or its address. An address needs --sha256.
    name
        By default that of the known network with this hash, or the file's own.
    sha256
        The hash that the file must have.
    licence
        Of the weights, as a note.
    replace
        Replace the model of this name.
    """
    from gesture_core.pose.downloads import downloaded
    from gesture_core.pose.model_store import add_model

    options: dict[str, Any] = {
        "contract": dict(map(_fact, contract)),
        "licence": licence,
        "sha256": sha256,
        "replace": replace,
    }
    if "://" in source:
        with _bar() as on_bytes, downloaded(source, sha256, on_bytes=on_bytes) as path:
            card = add_model(path, name, origin=source, **options)
    else:
        card = add_model(Path(source).expanduser(), name, **options)
    print(f"added {card.name}: {card.path}\nsha256 {card.sha256}")
    print("  ".join(part for part in (*_facts(card), card.licence) if part))
    print(f"use it with: --model {card.name}")
    return 0


@app.command
def verify() -> int:
    """Check every network that is here against its hash; exit with 3 where one differs."""
    from gesture_core.pose.model_store import verify_models

    found = verify_models()
    rows = [(name, trouble or "ok", str(path)) for name, path, trouble in found]
    print_list(("name", "status", "place"), rows, below=True)
    return 3 if any(trouble for _, _, trouble in found) else 0


def _facts(model: ModelFile) -> tuple[str, str]:
    """Output and input of a network, in words."""
    found = model.contract
    if found is None:
        return "seen at the first run", ""
    size = "x".join(map(str, reversed(found.input_size))) if found.input_size else "any size"
    return f"{found.layout} {found.skeleton}", f"{size} {found.colour}"


def _fact(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    if not equals:
        raise ModelError(f"--contract {text!r}", remedy="key=value, such as colour=rgb", code="E_OPTION")
    try:
        return key.strip(), tomllib.loads(f"v = {value}")["v"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()
