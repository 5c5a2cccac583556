"""``gesture``: the commands, and what every one of them does with errors, signals and closed pipes."""

from __future__ import annotations

import os
import re
import shlex
import signal
import sys
from collections.abc import Sequence
from types import FrameType

from cyclopts import App, CycloptsError, MissingArgumentError, Parameter, UnusedCliTokensError

from gesture_core import __version__
from gesture_core.errors import ConfigError, GestureError, InputError, ModelError, PluginError

EXIT_FATAL, EXIT_USAGE, EXIT_LOCKED, EXIT_PIPE = 1, 2, 11, 141
_USAGE = frozenset(
    "E_NOT_FOUND E_EMPTY E_EXISTS E_OPTION E_PLUGIN_UNKNOWN E_MANIFEST E_CONTRADICTION "
    "E_MODEL_UNKNOWN E_MODEL_EXISTS E_MODEL_NAME".split()
)
"""Codes of errors that another command line would not have met."""

app = App(
    name="gesture",
    help="A folder of videos and a folder of example gestures in, a table of labels out.",
    help_epilogue="Exit codes: 0 all done, 1 fatal, 2 usage, 3 finished with errors, degraded rows "
    "or lost examples, 11 another run holds the folder, 130 and 143 interrupted.",
    version=__version__,
    help_format="plaintext",
    default_parameter=Parameter(negative=()),
    suppress_keyboard_interrupt=False,
)

_TEMPORARY = re.compile(r"(\.[0-9a-f]{16}\.tmp-)+")

_COMMANDS = {
    "classify": "Label every input by the example gestures that it resembles.",
    "extract": "Find keypoints only, and write them to files.",
    "evaluate": "Measure the accuracy of a preset on a labelled archive.",
    "explain": "Show why an input of a run got its label.",
    "export": "Write the rows of a run as CSV, Parquet or JSON lines.",
    "render": "Draw the keypoints that the network sees over a video.",
    "plugins": "List every plugin, its kind, origin and status.",
    "models": "List, add and verify pose networks.",
    "bench": "Time every installed distance kernel on this machine.",
    "demo": "Run the main job on an archive that the package draws itself.",
}
for _name, _help in _COMMANDS.items():
    _target = "app" if _name in ("models", "plugins") else _name
    app.command(f"gesture_core.cli.{_name}:{_target}", name=_name, help=_help)


class _Terminated(BaseException):
    """SIGTERM came."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments: Sequence[str]) -> int:
    """Run one command; the exit code."""
    signal.signal(signal.SIGTERM, _on_sigterm)
    for stream in (sys.stdout, sys.stderr):  # any bytes may stand in a file name
        stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    try:
        result = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except CycloptsError as error:
        return _fail(_usage(error, arguments), EXIT_USAGE)
    except GestureError as error:
        return _fail(str(error), _exit_code(error))
    except BrokenPipeError:
        return _nobody_reads()
    except SystemExit as stop:
        if isinstance(stop.__context__, BrokenPipeError):  # the way in which Rich passes it on
            return _nobody_reads()
        raise
    except OSError as error:
        return _fail(_trouble(error), EXIT_FATAL)
    except KeyboardInterrupt:
        return _interrupted(arguments, 128 + signal.SIGINT)
    except _Terminated:
        return _interrupted(arguments, 128 + signal.SIGTERM)


def _on_sigterm(_number: int, _frame: FrameType | None) -> None:
    raise _Terminated


def _nobody_reads() -> int:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # later flushes must not fail
    return EXIT_PIPE


def _usage(error: CycloptsError, arguments: Sequence[str]) -> str:
    """A mistake on the command line, with what would have been right where that is known."""
    chain = error.command_chain or [name for name in arguments[:1] if name in _COMMANDS]
    remedy = " ".join(["gesture", *chain, "--help"])
    name = error.argument.name if error.argument else ""
    if isinstance(error, MissingArgumentError):
        cause = f"{name} {'needs a value' if name in arguments else 'is missing'}"
    elif isinstance(error, UnusedCliTokensError):
        cause = f"{shlex.join(error.unused_tokens or ())} is not understood here"
    else:
        cause, meant, rest = str(error).partition(" Did you mean ")
        cause = cause.partition(" Available commands")[0].rstrip(". ")
        remedy = f"{rest.partition('?')[0]}, or {remedy}" if meant else remedy
    return f"E_USAGE {cause}; try: {remedy}"


def _trouble(error: OSError) -> str:
    """What the operating system refused, said of the file that was wanted, not of a temporary one."""
    named = error.filename2 or error.filename
    cause = error.strerror or str(error)
    text = f"{_TEMPORARY.sub('', os.fsdecode(named))}: {cause}" if isinstance(named, str | bytes) else cause
    return f"E_OS {text}; kept: what was written before; try: check the disk and its permissions"


def _fail(text: str, code: int) -> int:
    from gesture_core.cli.screen import visible

    print("\n".join(map(visible, text.split("\n"))), file=sys.stderr)
    return code


def _interrupted(arguments: Sequence[str], code: int) -> int:
    if arguments[:1] in (["classify"], ["extract"], ["evaluate"]):  # keypoints that were found are kept
        return _fail(f"interrupted; resume with: gesture {shlex.join(arguments)}", code)
    return _fail("interrupted", code)


def _exit_code(error: GestureError) -> int:
    if error.code == "E_RUN_LOCKED":
        return EXIT_LOCKED
    asked = isinstance(error, InputError | PluginError | ModelError)
    usage = isinstance(error, ConfigError) or (asked and error.code in _USAGE)
    return EXIT_USAGE if usage or error.code == "E_NO_RUN" else EXIT_FATAL
