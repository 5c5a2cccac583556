"""The flags that commands share: those that change settings, and those that say how a run goes on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import Parameter, validators

from gesture_core.errors import ConfigError
from gesture_core.plugin import registry
from gesture_core.settings import Settings, load_settings, presets


def _whole(_kind: Any, tokens: Sequence[Any]) -> int:
    """A whole number and nothing else: 0.5 workers are not 0, which means one for each core."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise ValueError(f"{tokens[0].value!r} is no whole number") from None


Whole = Annotated[int, Parameter(converter=_whole)]


def _of_preset(text: str) -> Parameter:
    """A flag for one setting, whose default is that of the preset."""
    return Parameter(help=f"{text} [default: the preset's]")


@Parameter(name="*")
@dataclass(frozen=True)
class PoseFlags:
    """Flags that change settings, of commands that find people: defaults < preset < environment < flags."""

    preset: Annotated[
        str | None,
        Parameter(help=f"One of the package ({', '.join(presets())}), or a TOML file. [default: modern]"),
    ] = None
    set: Annotated[
        tuple[str, ...],
        Parameter(
            consume_multiple=False,
            show_default=False,
            help="Any setting or option of a plugin, as key=value, such as classify.margin=0.1; "
            "may be repeated.",
        ),
    ] = ()
    pose: Annotated[str | None, _of_preset("Pose backend: a name of 'gesture plugins'.")] = None
    model: Annotated[str | None, _of_preset("Pose network: a name of 'gesture models', or a file.")] = None

    def settings(self) -> Settings:
        """The settings that the flags ask for; an option of a plugin that takes no part is an error."""
        settings = load_settings(self.preset, self.set, **self._changes())
        for key in (text.partition("=")[0].strip() for text in self.set):
            check_part(key, settings)
        return settings

    def _changes(self) -> dict[str, Any]:
        """What the flags that stand for one setting say; None where one was not given."""
        return {"pose__backend": self.pose, "pose__model": self.model}


@Parameter(name="*")
@dataclass(frozen=True)
class KernelFlags(PoseFlags):
    """Those of commands that compute distances as well."""

    kernel: Annotated[
        str | None, _of_preset("Distance kernel: a name of 'gesture plugins', or auto for the fastest one.")
    ] = None

    def _changes(self) -> dict[str, Any]:
        return {**super()._changes(), "classify__kernel": self.kernel}


@Parameter(name="*")
@dataclass(frozen=True)
class Flags(KernelFlags):
    """Those of commands that give labels as well."""

    neighbors: Annotated[
        Whole | None, _of_preset("How many of the nearest examples vote; 0: all examples decide, weighed.")
    ] = None
    reject: Annotated[
        str | None,
        _of_preset("Give no label beyond this distance, or beyond mean + K sd of its class: '3sd'."),
    ] = None

    def _changes(self) -> dict[str, Any]:
        return {
            **super()._changes(),
            "classify__neighbors": self.neighbors,
            **_rejection(self.reject),
        }


UNSAID = Parameter(show_default=False)
"""For flags whose default is nothing: an empty text, no values, off."""


_REMEDIES = {
    "pose": "--pose {}",
    "normalizer": "--set signals.normalizer={}",
    "filter": "--set signals.filters=…,{}",
    "selector": "--set signals.selector={}",
}
"""How to choose a plugin, by its kind; of the other kinds several take part, or the fastest one."""


def _switch(text: str) -> Parameter:
    """A flag without a value, that is off by default."""
    return Parameter(help=text, show_default=False)


Workers = Annotated[
    Whole, Parameter(help="Worker processes; 0 for one for each core.", validator=validators.Number(gte=0))
]


@Parameter(name="*")
@dataclass(frozen=True)
class RunFlags:
    """Flags of the commands that write a run folder; none of them changes a result."""

    workers: Workers = 0
    engine: Annotated[str, Parameter(help="Execution engine: processes, or inline for debugging.")] = (
        "processes"
    )
    retry_errors: Annotated[bool, _switch("Try inputs again that ended in an error.")] = False
    overwrite: Annotated[
        bool, _switch("Begin again with other settings in the same folder; keypoints are reused.")
    ] = False
    quiet: Annotated[bool, _switch("No progress and no table.")] = False


def check_part(key: str, settings: Settings, origin: str = "--set") -> None:
    """Raise where ``key`` is an option of a plugin that the settings do not choose."""
    name = key.rpartition(".")[0].removeprefix("options.")
    kinds = {kind for kind, plugin in registry().entries if plugin == name.partition(":")[0]}
    if kinds and not settings.takes_part(name) and kinds <= _REMEDIES.keys():
        raise ConfigError(
            f"{origin} {key}: {name!r} takes no part under preset {settings.preset}",
            remedy=" or ".join(_REMEDIES[kind].format(name) for kind in sorted(kinds)),
            code="E_OPTION",
        )


def _rejection(value: str | None) -> dict[str, Any]:
    if value is None:
        return {}
    number, key = (value[:-2], "classify__reject_sd") if value.endswith("sd") else (value, "classify__reject")
    try:
        return {key: float(number)}
    except ValueError:
        raise ConfigError(
            f"--reject {value!r}", remedy="a distance such as 0.4, or standard deviations such as 3sd"
        ) from None
