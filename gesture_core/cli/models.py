"""``gesture models``: which pose networks there are, which hash and licence, and adding others."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import Annotated, Any

import cyclopts
from cyclopts import Parameter

from gesture_core.cli.flags import UNSAID
from gesture_core.errors import ModelError

app = cyclopts.App(
    name="models",
    help="List, add and verify pose networks.",
    help_format="plaintext",
    default_parameter=Parameter(negative=()),
)


@app.default
def list_models() -> int:
    """List the networks that are here, and the public ones that can be added."""
    from gesture_core.cli.output import print_table
    from gesture_core.files import models_dir
    from gesture_core.pose.models import added_names, find_model, known_models, read_card

    here: list[tuple[str, ...]] = []
    more: list[tuple[str, ...]] = []
    for name in added_names():
        try:
            card = read_card(name)
        except ModelError as error:
            here.append((name, f"broken: {error.cause}", "", "", "", str(models_dir() / name)))
            continue
        here.append((name, "added", *_facts(card.contract), card.sha256[:12], card.licence, str(card.path)))
    for known in known_models().values():
        if known.name in added_names():
            continue
        path = known.packaged_path
        if path is not None:
            hash_ = find_model(known.name).sha256[:12]
            facts = _facts(known.contract)
            here.append((known.name, "packaged", *facts, hash_, known.licence, str(path)))
        else:
            where = "missing from this installation" if known.packaged else known.where
            more.append((known.name, known.summary, known.licence, where))
    print_table(("name", "status", "output", "input", "sha256", "licence"), [row[:-1] for row in here])
    _print_places(here)
    if more:
        print("\nKnown, not here; bring the file with: gesture models add FILE")
        print_table(("name", "what it is", "licence"), [row[:-1] for row in more])
        _print_places(more)
    return 0


def _print_places(rows: list[tuple[str, ...]]) -> None:
    """Paths and addresses on lines of their own: a narrow table would break them."""
    from gesture_core.files import printable

    width = max((len(row[0]) for row in rows), default=0)
    for row in rows:
        print(f" {printable(row[0]):<{width}}   {printable(row[-1])}")


app.command(list_models, name="list")


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
        An .onnx, .pb or .caffemodel file, or its address. An address needs --sha256.
    name
        By default that of the known network with this hash, or the file's own.
    sha256
        The hash that the file must have.
    licence
        Of the weights, as a note.
    replace
        Replace the model of this name.
    """
    from gesture_core.pose.model_store import add_model, downloaded

    options: dict[str, Any] = {
        "contract": dict(map(_fact, contract)),
        "licence": licence,
        "sha256": sha256,
        "replace": replace,
    }
    if "://" in source:
        from rich.console import Console
        from rich.progress import BarColumn, DownloadColumn, Progress, TransferSpeedColumn

        columns = ("downloading", BarColumn(), DownloadColumn(), TransferSpeedColumn())
        with Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty()) as bar:
            task = bar.add_task("", total=None)
            with downloaded(source, sha256, on_bytes=lambda count: bar.advance(task, count)) as path:
                card = add_model(path, name, origin=source, **options)
    else:
        card = add_model(Path(source).expanduser(), name, **options)
    print(f"added {card.name}: {card.path}\nsha256 {card.sha256}")
    print("  ".join(part for part in (*_facts(card.contract), card.licence) if part))
    print(f"use it with: --model {card.name}")
    return 0


@app.command
def verify() -> int:
    """Check every network that is here against its hash; exit with 3 where one differs."""
    from gesture_core.cli.output import print_table
    from gesture_core.pose.model_store import verify_models

    found = verify_models()
    print_table(("name", "status"), [(name, trouble or "ok") for name, _, trouble in found])
    _print_places([(name, str(path)) for name, path, _ in found])
    return 3 if any(trouble for _, _, trouble in found) else 0


def _facts(contract: Any) -> tuple[str, str]:
    """Output and input of a network, in words."""
    if contract is None:
        return "seen at the first run", ""
    size = "x".join(map(str, reversed(contract.input_size))) if contract.input_size else "any size"
    return f"{contract.layout} {contract.skeleton}", f"{size} {contract.colour}"


def _fact(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    if not equals:
        raise ModelError(f"--contract {text!r}", remedy="key=value, such as colour=rgb", code="E_OPTION")
    try:
        return key.strip(), tomllib.loads(f"v = {value}")["v"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()
