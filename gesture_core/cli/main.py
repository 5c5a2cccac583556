"""``gesture``: the commands, and what every one of them does with errors, signals and closed pipes."""

from __future__ import annotations

import logging
import os
import re
import shlex
import signal
import sys
import traceback
from collections.abc import Sequence
from itertools import filterfalse
from types import FrameType

from cyclopts import App, CycloptsError, MissingArgumentError, Parameter, UnusedCliTokensError

from gesture_core import __version__
from gesture_core.cli.output import say, say_event
from gesture_core.errors import Code, ConfigError, GestureError
from gesture_core.files import printable, switched_on

EXIT_PIPE = 141
"""Of a command whose output was closed: 128 and the number of SIGPIPE."""

app = App(
    name="gesture",
    help="A folder of videos and a folder of example gestures in, a table of labels out.",
    help_epilogue="Exit codes: 0 all done, 1 fatal, 2 usage, 3 finished with errors, degraded rows "
    "or lost examples, 11 another run holds the folder, 130 and 143 interrupted. "
    "With any command: --traceback (GESTURE_TRACEBACK=1) shows where an error was raised, in a plugin "
    "too; --no-cache (GESTURE_NO_CACHE=1) does again what is in the cache.",
    version=__version__,
    help_format="plaintext",
    default_parameter=Parameter(negative=()),
)

_COMMANDS = {
    "classify": "Label every input by the example gestures that it resembles.",
    "spot": "Find the example gestures in long recordings: what happened when.",
    "watch": "Find the example gestures in a live source, as they happen.",
    "find": "Find where in recordings somebody does what a clip shows.",
    "cut": "Write the events of a run as clips, by label.",
    "extract": "Find keypoints only, and write them to files.",
    "merge": "Make one run of the runs of several shards.",
    "evaluate": "Measure the accuracy of a preset on a labelled archive.",
    "explain": "Show why an input of a run got its label.",
    "export": "Write the rows of a run as a table, or its events for ELAN and as subtitles.",
    "report": "Write a page about a run: clips, certainty, alignments.",
    "review": "Look at the rows of a run and say what they are; corrections become examples.",
    "render": "Draw the keypoints that the network sees over a video.",
    "settings": "List every setting, its type, meaning, default and value.",
    "plugins": "List every plugin, its kind, origin and status.",
    "models": "List, add and verify pose networks.",
    "cache": "Show or delete what the program has kept to save work.",
    "bench": "Time every installed distance kernel on this machine.",
    "demo": "Run the main job on an archive that the package draws itself.",
}
_PLACES = {
    "extract": "classify:extract",
    "spot": "classify:spot",
    "models": "models:app",
    "cache": "cache:app",
    "plugins": "plugins:app",
}
for _name, _help in _COMMANDS.items():
    app.command(f"gesture_core.cli.{_PLACES.get(_name, f'{_name}:{_name}')}", name=_name, help=_help)

_WITH_SETTINGS = {"extract": ("pose", "keypoints", "limits"), "render": ("pose", "limits"), "bench": ("dtw",)}
"""Sections whose settings have a meaning in a command that knows some alone."""
_OF_LABELS = ("reject", "reject_sd", "margin", "min_score", "confidence")
"""Settings of ``classify`` that refuse labels: events and places have none of them."""
_EMPTY = re.compile(r"--(examples|out|to)=")
_TEMPORARY = re.compile(r"(\.[0-9a-f]{16}\.tmp-)+")
FLAGS_OF_EVERY_COMMAND = {"--traceback": "GESTURE_TRACEBACK", "--no-cache": "GESTURE_NO_CACHE"}
"""Flags of every command, and the variables that are the same."""
_REPEATED = ("--set", "--grid", "--contract")
"""Options that take one key=value, and may be given again."""


class _Terminated(BaseException):
    """SIGTERM came."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments: Sequence[str]) -> int:
    """Run one command; the exit code."""
    signal.signal(signal.SIGTERM, _on_sigterm)
    if sys.stdout is None or sys.stderr is None:  # closed by the caller: files must not get their numbers
        sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: PTH123, SIM115
        sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: PTH123, SIM115
    for stream in (sys.stdout, sys.stderr):  # any bytes may stand in a file name
        stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    arguments = list(arguments)
    end = arguments.index("--") if "--" in arguments else len(arguments)
    asked = FLAGS_OF_EVERY_COMMAND.keys() & arguments[:end]
    arguments = [*filterfalse(asked.__contains__, arguments[:end]), *arguments[end:]]
    before = dict(os.environ)
    for flag in asked:
        os.environ[FLAGS_OF_EVERY_COMMAND[flag]] = "1"  # of worker processes, too
    notes = _Notes(logging.WARNING)
    logging.getLogger("gesture_core").addHandler(notes)
    try:
        return _done(arguments, traced=switched_on("GESTURE_TRACEBACK"))
    finally:
        logging.getLogger("gesture_core").removeHandler(notes)
        for name in map(FLAGS_OF_EVERY_COMMAND.__getitem__, asked):
            os.environ.pop(name, None)
            os.environ.update({name: before[name]} if name in before else {})


class _Notes(logging.Handler):
    """What the package and its plugins log, such as what a wait is for: a line for people or an event."""

    def emit(self, record: logging.LogRecord) -> None:
        if sys.stderr.isatty():
            say(record.getMessage())
        else:
            say_event("note", text=record.getMessage())


def _done(arguments: list[str], traced: bool) -> int:
    try:
        _refuse_empty(arguments)
        command, bound, _ = app.parse_args(arguments, exit_on_error=False, print_error=False)
        if "sources" in bound.arguments:
            _check_sources(arguments, bound.arguments["sources"])
        result = command(*bound.args, **bound.kwargs)
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except BrokenPipeError:
        return _closed_pipe()
    except SystemExit as stop:
        if isinstance(stop.__context__, BrokenPipeError):  # the way in which Rich passes it on
            return _closed_pipe()
        raise
    except CycloptsError as error:
        return _fail(_usage(error, arguments), Code.USAGE.exit_code, traced)
    except GestureError as error:
        return _fail(str(error), exit_code(error), traced)
    except OSError as error:
        return _fail(_refused(error), Code.OS.exit_code, traced)
    except KeyboardInterrupt:
        return _fail(_interrupted(arguments), 128 + signal.SIGINT, traced)
    except _Terminated:
        return _fail(_interrupted(arguments), 128 + signal.SIGTERM, traced)


def exit_code(error: GestureError) -> int:
    """That of its code; for a code of a third party, that of its class."""
    code = Code.of(error.code) or Code.of(type(error).code) or Code.GESTURE
    return code.exit_code


def _on_sigterm(_number: int, _frame: FrameType | None) -> None:
    raise _Terminated


def _closed_pipe() -> int:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # later flushes must not fail
    return EXIT_PIPE


def _fail(text: str, code: int, traced: bool) -> int:
    """Print an error that is being handled, and return the exit code."""
    text = f"{traceback.format_exc()}{text}" if traced else text
    print("\n".join(map(printable, text.split("\n"))), file=sys.stderr)
    return code


def _refuse_empty(arguments: Sequence[str]) -> None:
    """Refuse an empty text, as of an unset variable of the shell: it would be the working directory."""
    for place, word in enumerate(arguments):
        if not word or _EMPTY.fullmatch(word):
            before = word or arguments[place - 1] if place else "an argument"
            what = before.rstrip("=") if before.startswith("-") else "an argument"
            remedy = 'a value; perhaps a variable of the shell is not set, as in "$DIR"'
            raise ConfigError(f"{what} is empty", remedy=remedy, code="E_USAGE")


def _check_sources(arguments: Sequence[str], sources: Sequence[str]) -> None:
    """Refuse sources that may be further values of an option that takes one."""
    for source in sources:
        if "=" in source and not os.path.lexists(source) and (remedy := _again(arguments, source)):
            raise ConfigError(f"{source} would be a source", remedy=remedy, code="E_USAGE")
    words, most = list(arguments), 0
    if "--" in words:
        words.remove("--")
    for start in range(len(words)):  # sources keep their order: how many of them stand side by side?
        n = 0
        while n < len(sources) and start + n < len(words) and words[start + n] == sources[n]:
            n += 1
        most = max(most, n)
    if most < len(sources):
        raise ConfigError(
            f"{sources[most]} stands apart from the other sources, behind an option",
            remedy="all sources before the options, or last after --",
            code="E_USAGE",
        )


def _again(arguments: Sequence[str], word: str) -> str:
    """How to write ``word``, where it is a further value behind an option that takes one."""
    place = list(arguments).index(word)
    option = next((w.partition("=")[0] for w in reversed(arguments[:place]) if w.startswith("-")), "")
    return f"{option} again: {option} KEY=VALUE {option} {word}" if option in _REPEATED else ""


def _usage(error: CycloptsError, arguments: Sequence[str]) -> str:
    """A mistake on the command line, with what would have been right where that is known."""
    chain = error.command_chain or [name for name in arguments[:1] if name in _COMMANDS]
    remedy = " ".join(["gesture", *chain, "--help"])
    name = error.argument.name if error.argument else ""
    if isinstance(error, MissingArgumentError) and name == "SOURCES" and "--examples" in arguments:
        cause = "SOURCES is missing: --examples takes everything up to the next option"
        remedy = "the sources before --examples, or last after --"
    elif isinstance(error, MissingArgumentError):
        cause = f"{name} {'needs a value' if name in arguments else 'is missing'}"
    elif isinstance(error, UnusedCliTokensError):
        unused = error.unused_tokens or [""]
        cause = f"{shlex.join(unused)} is not understood here"
        remedy = _again(arguments, unused[0]) or remedy
    else:
        cause, meant, rest = str(error).partition(" Did you mean ")
        cause = cause.partition(" Available commands")[0].rstrip(". ")
        option = cause.rpartition(" --")[2].replace("-", "_")
        command = next(iter(chain), "")
        owners = _owners(option, command) if cause.startswith("Unknown option") else []
        if option in _OF_LABELS and command in ("spot", "watch"):
            remedy = "--set spot.tolerance=VALUE or --set spot.threshold=VALUE, which events have instead"
        elif owners:
            remedy = " or ".join(f"--set {owner}.{option}=VALUE" for owner in owners)
        elif meant:
            remedy = f"{rest.partition('?')[0]}, or {remedy}"
    return f"{Code.USAGE} {cause}; try: {remedy}"


def _owners(option: str, command: str) -> list[str]:
    """Sections that have a setting called ``option`` with a meaning in ``command``."""
    from gesture_core.settings.load import fields_of
    from gesture_core.settings.schema import SECTIONS

    if option in _OF_LABELS and command == "find":
        return []
    every = tuple(SECTIONS) if command in ("classify", "evaluate", "demo", "spot", "watch", "find") else ()
    return [section for section in _WITH_SETTINGS.get(command, every) if option in fields_of(section)]


def _refused(error: OSError) -> str:
    """What the operating system refused, about the file that was wanted, not a temporary one."""
    wanted = error.filename2 or error.filename
    cause = error.strerror or str(error)
    if isinstance(wanted, str | bytes):
        cause = f"{_TEMPORARY.sub('', os.fsdecode(wanted))}: {cause}"
    return f"{Code.OS} {cause}; kept: what was written before; try: {Code.OS.remedy}"


def _interrupted(arguments: Sequence[str]) -> str:
    if arguments and arguments[0] in ("classify", "spot", "extract", "evaluate"):  # keypoints are kept
        from gesture_core.run.addresses import shown

        return f"interrupted; resume with: gesture {shlex.join(map(shown, arguments))}"
    return "interrupted"
