"""Writes a plugin to begin with: a whole distribution, with a working example and tests that pass.

The files beside this one are its templates, filled in by `string.Template`: those of every kind here,
those of one kind in the folder of its name.
"""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path
from string import Template

from gesture_core.errors import ConfigError, near
from gesture_core.plugin.hooks import KINDS
from gesture_core.plugin.registry import registry

_FOLDER = Path(__file__).parent
_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_EXAMPLES = {
    "video": ("Reader", "every frame of a video, or one of so many, by OpenCV"),
    "pose": ("Backend", "the brightest pixels on each side, as a toy"),
    "reader": ("Reader", "keypoints in plain text, a line for each frame"),
    "normalizer": ("Normalizer", "the middle of the hips at the origin, their distance 1"),
    "filter": ("Filter", "a channel for each joint: how fast it moves"),
    "selector": ("Selector", "the channels that move nearly as far as any does"),
    "kernel": ("Kernel", "the same share of both sequences compared, without warping"),
    "classifier": ("Classifier", "the class whose examples are the nearest on average"),
    "writer": ("Writer", "a table in Markdown"),
    "engine": ("Engine", "one task after the other in this process"),
}
"""What the example of each kind is called at the end, and what it does."""


def write_plugin(kind: str, name: str, out: Path) -> list[Path]:
    """Write the distribution ``gesture-NAME`` with one plugin, which installs and passes its tests.

    Parameters
    ----------
    kind : str
        A key of `gesture_core.plugin.hooks.KINDS`.
    name : str
        Of the plugin: lower-case letters, digits and hyphens, a letter first.
    out : Path
        The folder in which ``gesture-NAME/`` is made.

    Returns
    -------
    list of Path
        The files, the distribution's folder first.

    Raises
    ------
    ConfigError
        E_OPTION for a kind that does not exist or a name that cannot be used, E_EXISTS where the
        folder, or a plugin or package of this name, is already there.
    """
    module = name.replace("-", "_")
    package, folder = f"gesture_{module}", out / f"gesture-{name}"
    _check(kind, name, package)
    ending, summary = _EXAMPLES[kind]
    values = {
        "kind": kind,
        "title": KINDS[kind].title,
        "hook": KINDS[kind].hook,
        "name": name,
        "module": module,
        "package": package,
        "class_name": "".join(part.capitalize() for part in name.split("-")) + ending,
        "summary": summary,
    }
    values["usage"] = _filled(f"{kind}/usage.txt", values)
    texts = {
        folder / "pyproject.toml": _filled("pyproject.toml", values),
        folder / "README.md": _filled("README.md", values),
        folder / package / "__init__.py": _filled("__init__.py", values),
        folder / package / "hooks.py": _filled("hooks.py", values),
        folder / package / f"{kind}.py": _filled(f"{kind}/{kind}.py", values),
        folder / "tests" / f"test_{module}.py": _filled(f"{kind}/test.py", values),
    }
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise ConfigError(
            "is already there", subject=str(folder), remedy="another name, or another --out", code="E_EXISTS"
        ) from None
    for path, text in texts.items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return [folder, *texts]


def _check(kind: str, name: str, package: str) -> None:
    """Raise where there is no such kind, or where the name is malformed or taken."""
    if kind not in KINDS:
        raise ConfigError(f"no kind of plugin {kind!r}", remedy=near(kind, list(KINDS)), code="E_OPTION")
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"{name!r} is no name of a plugin",
            remedy="lower-case letters, digits and hyphens, a letter first",
            code="E_OPTION",
        )
    taken = registry().entries.get((kind, name))
    if taken or find_spec(package):
        what = f"{taken[0].title} of {taken[0].origin}" if taken else f"the package {package}"
        raise ConfigError(f"{what} is installed already", remedy="another name", code="E_EXISTS")


def _filled(file: str, values: dict[str, str]) -> str:
    return Template((_FOLDER / f"{file}.template").read_text("utf-8")).substitute(values)
