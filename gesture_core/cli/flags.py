"""The flags that commands share: those that change settings, and those that say how a run goes on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import Parameter, Token, validators

from gesture_core.errors import ConfigError
from gesture_core.settings import Settings, load_settings, presets
from gesture_core.settings.load import check_option

_BY_PRESET = "[default: the preset's]"
_SETTINGS = {
    "pose": "pose__backend",
    "model": "pose__model",
    "kernel": "classify__kernel",
    "neighbors": "classify__neighbors",
}
"""The settings that flags stand for, by the flag's name."""


def _whole(_kind: Any, tokens: Sequence[Token]) -> int:
    """A whole number and nothing else: 0.5 workers are not 0, which means one for each core."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise ValueError(f"{tokens[0].value!r} is no whole number") from None


Whole = Annotated[int, Parameter(converter=_whole)]
Workers = Annotated[
    Whole, Parameter(help="Worker processes; 0 for one for each core.", validator=validators.Number(gte=0))
]
Sources = Annotated[str, Parameter(required=True)]
SEVERAL = Parameter(consume_multiple=True)
"""For an option that takes everything up to the next one, as a shell's pattern gives it."""
REPEATED = Parameter(consume_multiple=False, show_default=False)
"""For an option that takes one value, and may be given again."""
UNSAID = Parameter(show_default=False)
"""For an option whose default is nothing: an empty text, no values, off."""


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
        REPEATED,
        Parameter(
            help="Any setting or option of a plugin, as key=value, such as classify.margin=0.1; "
            "--set again for each further one. 'gesture settings' lists them."
        ),
    ] = ()
    pose: Annotated[
        str | None, Parameter(help=f"Pose backend: a name of 'gesture plugins'. {_BY_PRESET}")
    ] = None
    model: Annotated[
        str | None, Parameter(help=f"Pose network: a name of 'gesture models', or a file. {_BY_PRESET}")
    ] = None

    def settings(self) -> Settings:
        """The settings that the flags ask for; an option of a plugin that takes no part is an error."""
        changes: dict[str, Any] = {}
        for flag, value in vars(self).items():
            if flag == "reject" and value is not None:
                changes |= _rejection(value)
            elif flag in _SETTINGS:
                changes[_SETTINGS[flag]] = value
        settings = load_settings(self.preset, self.set, **changes)
        for text in self.set:
            check_option(text.partition("=")[0].strip(), settings, "--set")
        return settings


@Parameter(name="*")
@dataclass(frozen=True)
class KernelFlags(PoseFlags):
    """Those of commands that compute distances as well."""

    kernel: Annotated[
        str | None,
        Parameter(
            help=f"Distance kernel: a name of 'gesture plugins', or auto for the fastest one. {_BY_PRESET}"
        ),
    ] = None


@Parameter(name="*")
@dataclass(frozen=True)
class SpotFlags(KernelFlags):
    """Those of commands that find events as well."""

    neighbors: Annotated[
        Whole | None,
        Parameter(help=f"How many of the nearest examples vote; 0: all examples decide. {_BY_PRESET}"),
    ] = None


@Parameter(name="*")
@dataclass(frozen=True)
class Flags(SpotFlags):
    """Those of commands that give labels as well."""

    reject: Annotated[
        str | None,
        Parameter(
            help="Give no label beyond this distance, or beyond mean + K standard deviations of its class: "
            f"'3sd'. {_BY_PRESET}"
        ),
    ] = None


@Parameter(name="*")
@dataclass(frozen=True)
class RunFlags:
    """Flags of the commands that write a run folder; none of them changes a result."""

    workers: Workers = 0
    engine: Annotated[str, Parameter(help="Execution engine: processes, or inline for debugging.")] = (
        "processes"
    )
    retry_errors: Annotated[bool, UNSAID, Parameter(help="Try inputs again that ended in an error.")] = False
    overwrite: Annotated[
        bool,
        UNSAID,
        Parameter(help="Begin again with other settings in the same folder; keypoints are reused."),
    ] = False
    shard: Annotated[
        str,
        UNSAID,
        Parameter(help="K/N: only the K-th of N parts of the inputs; 'gesture merge' makes one run of all."),
    ] = ""
    quiet: Annotated[bool, UNSAID, Parameter(help="No progress and no table.")] = False


def _rejection(value: str) -> dict[str, float]:
    number, key = (value[:-2], "classify__reject_sd") if value.endswith("sd") else (value, "classify__reject")
    try:
        return {key: float(number)}
    except ValueError:
        raise ConfigError(
            f"--reject {value!r}", remedy="a distance such as 0.4, or standard deviations such as 3sd"
        ) from None
