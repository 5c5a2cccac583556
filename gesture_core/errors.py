"""Every error that the package raises on purpose: a code, a cause, what was kept, a remedy.

The printed form is ``<CODE> <subject>: <cause>; kept: <kept>; try: <remedy>``; parts that
are empty are left out. Errors survive pickling, as those of libraries that run things in parallel should.
"""

from __future__ import annotations

from typing import Any


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
        """The same error, said of ``subject`` where it names none yet."""
        if not self.subject:
            self.subject = subject
        return self

    @property
    def message(self) -> str:
        """The printed form without the code: ``<subject>: <cause>; kept: …; try: …``."""
        text = f"{self.subject}: {self.cause}" if self.subject else self.cause
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
    """A source, example library or array that cannot be used."""

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


class WarpingError(GestureError):
    """A warping distance that is not defined: an infeasible band, an empty or infinite series."""

    code = "E_DTW"


class PluginError(GestureError):
    """A plugin that is unknown, ambiguous, broken, or that broke its contract."""

    code = "E_PLUGIN"


class MissingDependencyError(PluginError):
    """A plugin whose optional dependency is not installed."""

    code = "E_MISSING_DEPENDENCY"


class RunFolderError(GestureError):
    """A run folder that is locked, damaged, or was made with other settings."""

    code = "E_RUN"
