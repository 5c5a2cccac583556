"""Every error that the package raises on purpose, and every code that an error or a row may have.

The printed form of an error is ``<CODE> <subject>: <cause>; kept: <kept>; try: <remedy>``; parts that
are empty are left out. Errors survive pickling, as those of libraries that run things in parallel should.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import Any, Literal, Self

Status = Literal["ok", "degraded", "rejected", "skipped", "error"]


class Code(StrEnum):
    """Codes of errors and rows; each is the text that stands in the row.

    Codes of third parties are kept as they are and are no members: see `of`.

    Attributes
    ----------
    meaning : str
        What happened, in one clause.
    remedy : str
        What helps in most cases; the message of an error knows more about its own.
    exit_code : int
        Of a command that ends with such an error: 2 where another command line would not have met it,
        11 where another run holds the folder, otherwise 1.
    status : str
        Of a row with this code. A row without a label is an ``error`` also where the status is ``degraded``.
    plugin : bool
        Whether a plugin is to blame, and not the input.

    Examples
    --------
    >>> Code.NO_PERSON.status
    'rejected'
    >>> Code.of("E_OF_ANOTHER_PACKAGE") is None
    True
    """

    meaning: str
    remedy: str
    exit_code: int
    status: Status
    plugin: bool

    def __new__(
        cls, code: str, meaning: str, remedy: str, exit_code: int = 1, status: Status = "error",
        plugin: bool = False,
    ) -> Self:  # fmt: skip
        member = str.__new__(cls, code)
        member._value_ = code
        member.meaning, member.remedy = meaning, remedy
        member.exit_code, member.status, member.plugin = exit_code, status, plugin
        return member

    @classmethod
    def of(cls, code: str) -> Code | None:
        """The member that ``code`` is the text of; None for codes of third parties."""
        member = cls.__members__.get(code.removeprefix("E_"))
        return member if member == code else None

    # fmt: off
    # The command line and the settings.
    USAGE = "E_USAGE", "the command line is not understood", "gesture COMMAND --help", 2
    CONFIG = "E_CONFIG", "a setting, preset, flag or environment variable is wrong", "gesture settings", 2
    OPTION = "E_OPTION", "a value that is not allowed", "gesture settings KEY, or --help", 2
    PRESET = "E_PRESET", "no such preset, or it cannot be read", "gesture settings, or a TOML file", 2
    OUT = "E_OUT", "nothing can be written where the result is wanted", "another --out, or its permissions", 2
    EXISTS = "E_EXISTS", "a file or folder is already there", "--overwrite, or another name", 2
    MISSING_DEPENDENCY = "E_MISSING_DEPENDENCY", "an optional package is not installed", "pip install it"
    OS = "E_OS", "the operating system refused", "check the disk and its permissions"

    # Sources, examples and their labels.
    INPUT = "E_INPUT", "a source, example or array cannot be used", "another one"
    NOT_FOUND = "E_NOT_FOUND", "no such file, folder or row", "check the path or the name", 2
    EMPTY = "E_EMPTY", "there is nothing to work on", "another path", 2
    MANIFEST = "E_MANIFEST", "a list of inputs cannot be read", "save it as UTF-8 text or CSV", 2
    LABELS = "E_LABELS", "labels cannot be found, or tell nothing apart", "other --labels", 2
    CONTRADICTION = "E_CONTRADICTION", "one input or movement has two labels", "only the right one", 2
    EXAMPLES = "E_EXAMPLES", "no example can be used", "better clips"
    NEIGHBORS = "E_NEIGHBORS", "more neighbours than examples", "--neighbors with fewer, or 0", 2
    REJECT = "E_REJECT", "a threshold needs two examples of one class", "more examples, or a distance", 2
    SUBJECTS = "E_SUBJECTS", "who performs is unknown, or too few people do", "other --subjects", 2
    SPLIT = "E_SPLIT", "a split leaves no example or no query", "another --train", 2
    READ = "E_READ", "cannot be read or listed", "check what it is and its permissions"
    SOURCE = "E_SOURCE", "a camera or stream cannot be read, or has ended", "its cable, number or address"
    CHANGED = "E_CHANGED", "was written while it was in use, or since the run", "the same command again"

    # Videos.
    MEDIA = "E_MEDIA", "a video cannot be used", "repair or re-encode it"
    MEDIA_MISSING = "E_MEDIA_MISSING", "no such video file", "check the path"
    MEDIA_UNREADABLE = "E_MEDIA_UNREADABLE", "a video cannot be opened or read", "check its permissions"
    MEDIA_EMPTY = "E_MEDIA_EMPTY", "a video file has no bytes", "copy it again"
    MEDIA_FORMAT = "E_MEDIA_FORMAT", "the first bytes are of no known video container", "convert it"
    MEDIA_BROKEN = "E_MEDIA_BROKEN", "a video file is damaged", "copy, repair or re-encode it"
    MEDIA_CODEC = "E_MEDIA_CODEC", "no decoder for the codec of a video", "re-encode it"
    MEDIA_NO_VIDEO = "E_MEDIA_NO_VIDEO", "a media file holds no video stream", "leave it out"
    MEDIA_NO_FRAMES = "E_MEDIA_NO_FRAMES", "not one frame of a video can be decoded", "copy or re-encode it"
    MEDIA_LIMIT = "E_MEDIA_LIMIT", "a video exceeds a limit", "a larger limit"
    MEDIA_MEMORY = "E_MEDIA_MEMORY", "not enough memory to decode a video", "a smaller video"
    MEDIA_WRITE = "E_MEDIA_WRITE", "a video or picture cannot be written", "another --out"
    MEDIA_PARTIAL = "E_MEDIA_PARTIAL", "frames of a video are lost", "repair the file", 1, "degraded"

    # Keypoint files.
    KEYPOINTS = "E_KEYPOINTS", "keypoints cannot be used", "check how the file was made"
    KEYPOINTS_MISSING = "E_KEYPOINTS_MISSING", "no such keypoint file", "check the path"
    KEYPOINTS_UNREADABLE = "E_KEYPOINTS_UNREADABLE", "a keypoint file cannot be read", "check its permissions"
    KEYPOINTS_EMPTY = "E_KEYPOINTS_EMPTY", "a keypoint file holds no frame", "make it again"
    KEYPOINTS_BROKEN = "E_KEYPOINTS_BROKEN", "a keypoint file is damaged", "copy or make it again"
    KEYPOINTS_FORMAT = "E_KEYPOINTS_FORMAT", "a keypoint file is of another format", "a supported format"
    KEYPOINTS_JSON = "E_KEYPOINTS_JSON", "a keypoint file is not JSON", "make it again"
    KEYPOINTS_SHAPE = "E_KEYPOINTS_SHAPE", "keypoints have the wrong shape", "(T, J, 2 or 3) arrays"
    KEYPOINTS_VALUE = "E_KEYPOINTS_VALUE", "a keypoint is no finite number", "NaN where a joint is missing"
    KEYPOINTS_TIMES = "E_KEYPOINTS_TIMES", "times are not finite, ascending seconds", "correct the times"
    KEYPOINTS_SKELETON = "E_KEYPOINTS_SKELETON", "the joints are of no known layout", "name the skeleton"
    KEYPOINTS_MEMBER = "E_KEYPOINTS_MEMBER", "a file has no sequence of this name", "one of those it has"
    KEYPOINTS_IMPLAUSIBLE = (
        "E_KEYPOINTS_IMPLAUSIBLE", "keypoints of no possible body", "other --set keypoints.…=…"
    )
    KEYPOINTS_LIMIT = "E_KEYPOINTS_LIMIT", "a keypoint file exceeds a limit", "split it"
    SKELETON = "E_SKELETON", "no such skeleton", "one that the message lists"

    # People and their movement.
    POSE = "E_POSE", "a pose cannot be used", "another --model or --pose"
    POSE_FRAME = "E_POSE_FRAME", "an array is no picture", "(H, W, 3) uint8 arrays in BGR"
    POSE_PEOPLE = "E_POSE_PEOPLE", "the network cannot tell people apart", "--set pose.people=single"
    NO_PERSON = "E_NO_PERSON", "nobody was found", "another view, a lower presence limit", 1, "rejected"
    POSE_SHORT = "E_POSE_SHORT", "too few frames, or samples of a sensor", "a longer clip", 1, "rejected"
    POSE_SPARSE = "E_POSE_SPARSE", "joints are seen in too few frames", "another clip", 1, "rejected"
    POSE_SCALE = "E_POSE_SCALE", "the body gives no scale or origin", "another normalizer", 1, "rejected"
    NO_SALIENT = "E_NO_SALIENT", "nothing moves enough to be compared", "another clip", 1, "rejected"
    NO_COMMON = "E_NO_COMMON", "no channel in common with any example", "other examples", 1, "rejected"
    REJECTED = "E_REJECTED", "no example is near enough", "a larger --reject", 1, "rejected"
    NO_EVENT = "E_NO_EVENT", "no example was found in a recording", "more examples", 1, "rejected"
    UNSURE = "E_UNSURE", "two gestures are about as likely", "a lower --set classify.margin=…", 1, "rejected"
    NOT_AN_INPUT = "E_NOT_AN_INPUT", "no video, keypoints or series", "leave it out", 1, "skipped"

    # Pose networks.
    MODEL = "E_MODEL", "a pose network cannot be used", "gesture models"
    MODEL_UNKNOWN = "E_MODEL_UNKNOWN", "no pose network of this name", "gesture models", 2
    MODEL_MISSING = "E_MODEL_MISSING", "a known pose network is not installed", "gesture models add"
    MODEL_EXISTS = "E_MODEL_EXISTS", "there is a pose network of this name", "--replace, or another --name", 2
    MODEL_NAME = "E_MODEL_NAME", "this is no name for a pose network", "lower-case letters and digits", 2
    MODEL_CARD = "E_MODEL_CARD", "the entry of a pose network is damaged", "add the network again"
    MODEL_CHANGED = "E_MODEL_CHANGED", "a model file changed after it was found", "gesture models verify"
    MODEL_HASH = "E_MODEL_HASH", "a model file has another SHA-256", "get the file again"
    MODEL_FILE = "E_MODEL_FILE", "a model file is damaged or cannot be read", "get the file again"
    MODEL_SIZE = "E_MODEL_SIZE", "a model file is too large", "a smaller network"
    MODEL_EXTERNAL = "E_MODEL_EXTERNAL", "a model keeps weights in other files", "save it as one file"
    MODEL_FORMAT = "E_MODEL_FORMAT", "this backend does not read such models", "another --pose"
    MODEL_CONTRACT = "E_MODEL_CONTRACT", "facts about a network exclude each other", "correct --contract"
    MODEL_INPUT = "E_MODEL_INPUT", "the network does not take one picture", "another network"
    MODEL_LAYOUT = "E_MODEL_LAYOUT", "the network's outputs are of no known layout", "another network"
    MODEL_LOAD = "E_MODEL_LOAD", "the runtime cannot load the network", "gesture models verify"
    MODEL_RUN = "E_MODEL_RUN", "the runtime cannot run the network", "another network"
    MODEL_PROBE = "E_MODEL_PROBE", "the network fails on a known picture", "another --model or --pose"
    PROVIDER = "E_PROVIDER", "what a network should run on is not there", "--set pose.provider=auto"
    MODEL_URL = "E_MODEL_URL", "an address cannot be fetched", "download the file yourself"
    OFFLINE = "E_OFFLINE", "downloads are switched off", "unset GESTURE_OFFLINE, or add a file"

    # Signals and distances.
    SIGNAL = "E_SIGNAL", "no usable signal can be made", "another filter or normalizer"
    SIGNAL_SHAPE = "E_SIGNAL_SHAPE", "signals have the wrong shape", "(T, D) values with T times"
    SIGNAL_VALUE = "E_SIGNAL_VALUE", "a signal is not finite", "a filter that fills gaps before this one"
    SIGNAL_TIMES = "E_SIGNAL_TIMES", "times of a signal are not finite and ascending", "correct the times"
    SIGNAL_CHANNELS = "E_SIGNAL_CHANNELS", "a filter needs channels that are gone", "another order of filters"
    SIGNAL_SHORT = "E_SIGNAL_SHORT", "a series is too short for its derivative", "series of 3 frames or more"
    MIRROR = "E_MIRROR", "a channel has no counterpart on the other side", "--set classify.mirror=none"
    BAND_INFEASIBLE = "E_BAND_INFEASIBLE", "no warping path fits into the band", "a wider --set dtw.window=…"
    KERNEL_UNSUPPORTED = "E_KERNEL_UNSUPPORTED", "a kernel does not compute this", "--kernel auto"
    DIMENSIONS = "E_DIMENSIONS", "series or arrays of different widths", "series of one preset"
    DTYPE = "E_DTYPE", "a series holds no real numbers", "arrays of floats"
    NOT_FINITE = "E_NOT_FINITE", "a series holds NaN or infinity", "fill the gaps first"
    MAGNITUDE = "E_MAGNITUDE", "values are too large or small for the costs", "float64, or another unit"
    MIXED = "E_MIXED", "bare arrays and signals cannot be compared", "all of one kind"

    # Plugins and the worker processes that run them.
    PLUGIN = "E_PLUGIN", "a plugin cannot be used", "gesture plugins", 1, "error", True
    PLUGIN_UNKNOWN = "E_PLUGIN_UNKNOWN", "no plugin of this name", "gesture plugins", 2, "error", True
    PLUGIN_AMBIGUOUS = "E_PLUGIN_AMBIGUOUS", "two plugins have one name", "uninstall one", 1, "error", True
    PLUGIN_IMPORT = "E_PLUGIN_IMPORT", "a plugin cannot be imported", "repair or remove it", 1, "error", True
    PLUGIN_RAISED = "E_PLUGIN_RAISED", "a plugin raised an error", "another, or report it", 1, "error", True
    PLUGIN_CONTRACT = "E_PLUGIN_CONTRACT", "a plugin broke its contract", "report it", 1, "error", True
    WORKER_CRASH = "E_WORKER_CRASH", "a worker process ended", "--retry-errors", 1, "error", True
    WORKER_HANG = (
        "E_WORKER_HANG", "a worker made no progress", "more --set limits.seconds=…", 1, "error", True
    )
    WORKER_MEMORY = (
        "E_WORKER_MEMORY", "a worker took too much memory", "more --set limits.memory=…", 1, "error", True
    )

    # Run folders and the keypoint store.
    RUN = "E_RUN", "a run folder cannot be used", "another --out"
    NO_RUN = "E_NO_RUN", "the folder holds no run", "a folder that gesture classify wrote", 2
    RUN_LOCKED = "E_RUN_LOCKED", "another run holds the folder", "wait for it, or another --out", 11
    RUN_DAMAGED = "E_RUN_DAMAGED", "run.db cannot be read", "another --out"
    RUN_VERSION = "E_RUN_VERSION", "run.db is of another version", "another --out"
    RUN_WRITE = "E_RUN_WRITE", "the run folder cannot be written", "free space, then the same command again"
    CONFIG_CHANGED = "E_CONFIG_CHANGED", "the run has other settings or examples", "--overwrite", 2
    MERGE = "E_MERGE", "runs cannot be made one", "the runs of one command, each shard once", 2
    STORE = "E_STORE", "a file of the keypoint store is damaged", "the same command again"
    STORE_WRITE = "E_STORE_WRITE", "the keypoint store cannot be written", "another GESTURE_CACHE"
    GESTURE = "E_GESTURE", "an error of no other code", "the message says more"
    # fmt: on


def near(word: str, known: Sequence[str], otherwise: str = "") -> str:
    """A remedy for a word that is none of those known: the ones that are spelled alike, or all of them.

    ``otherwise`` says where they are listed, instead of listing them.
    """
    import difflib

    alike = difflib.get_close_matches(str(word), known, 3)
    every = otherwise or f"one of {', '.join(known) or '(none)'}"
    return f"did you mean {' or '.join(alike)}? {otherwise}".rstrip() if alike else every


def described(error: BaseException) -> str:
    """The class and text of an exception, which may fail to have any text."""
    try:
        return f"{type(error).__name__}: {error}"
    except Exception:  # noqa: BLE001 - it is somebody else's class
        return type(error).__name__


class GestureError(Exception):
    """Base of all errors of the package.

    Parameters
    ----------
    cause : str
        What happened, in one clause.
    subject : str
        The input, file, plugin or setting that it happened to.
    kept : str
        What is still valid in spite of the error.
    remedy : str
        What the user can do about it.
    code : str, optional
        Overrides the class's code with a more precise one.
    """

    code = "E_GESTURE"

    def __init__(
        self, cause: str, *, subject: str = "", kept: str = "", remedy: str = "", code: str | None = None
    ) -> None:
        super().__init__(cause)
        self.cause = cause
        self.subject = subject
        self.kept = kept
        self.remedy = remedy
        if code is not None:
            self.code = code

    def about(self, subject: str) -> GestureError:
        """The same error about ``subject``, where it names none yet."""
        if not self.subject:
            self.subject = subject
        return self

    @property
    def message(self) -> str:
        """The printed form without the code: ``<subject>: <cause>; kept: …; try: …``."""
        return f"{self.subject}: {self.reason}" if self.subject else self.reason

    @property
    def reason(self) -> str:
        """The message without the subject, for a row, which names its input itself."""
        text = self.cause
        if self.kept:
            text += f"; kept: {self.kept}"
        if self.remedy:
            text += f"; try: {self.remedy}"
        return text

    def __str__(self) -> str:
        return f"{self.code} {self.message}"

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), self.cause, self.subject, self.kept, self.remedy, self.code)


def _rebuild(
    kind: type[GestureError], cause: str, subject: str, kept: str, remedy: str, code: str
) -> GestureError:
    return kind(cause, subject=subject, kept=kept, remedy=remedy, code=code)


class ConfigError(GestureError):
    """A setting, preset, flag or environment variable that cannot be used."""

    code = "E_CONFIG"


class InputError(GestureError):
    """A source, example library, array or series that cannot be used."""

    code = "E_INPUT"


class MediaError(GestureError):
    """A video that cannot be opened or decoded."""

    code = "E_MEDIA"


class KeypointError(GestureError):
    """A keypoint file that cannot be read."""

    code = "E_KEYPOINTS"


class PoseError(GestureError):
    """Keypoints that are too sparse, or a pose network that cannot be used."""

    code = "E_POSE"


class ModelError(GestureError):
    """A model file that is missing, changed, unsafe or of an unknown layout."""

    code = "E_MODEL"


class SignalError(GestureError):
    """Keypoints from which no usable signal can be made."""

    code = "E_SIGNAL"


class PluginError(GestureError):
    """A plugin that is unknown, ambiguous, broken, or that broke its contract."""

    code = "E_PLUGIN"


class MissingDependencyError(PluginError):
    """A plugin whose optional dependency is not installed."""

    code = "E_MISSING_DEPENDENCY"


class WorkerError(PluginError):
    """A worker process has ended, or had to be ended, before its task was done.

    The subject is the plugin that was being called, where one was.
    """

    code = "E_WORKER_CRASH"

    @property
    def message(self) -> str:
        """As of other errors."""
        return f"{self.subject}: {super().reason}" if self.subject else super().reason

    @property
    def reason(self) -> str:
        """All of the message: a row does not name the plugin otherwise."""
        return self.message


class RunFolderError(GestureError):
    """A run folder that is locked, damaged, or was made with other settings."""

    code = "E_RUN"
