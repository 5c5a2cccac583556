"""The kinds of plugin, and the hook by which each is announced.

A plugin module implements any of these with `hookimpl` and calls ``register`` once for each
thing that it brings. See `Register` for the arguments.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import pluggy

PROJECT = "gesture_core"
hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@dataclass(frozen=True)
class Kind:
    """A kind of plugin: its name in the registry, its hook, and its name in sentences.

    ``given`` are parameters that the program fills in, so that they are no options; ``offered`` are
    those that it fills in where a class takes them.
    """

    name: str
    hook: str
    title: str
    given: tuple[str, ...] = ()
    offered: tuple[str, ...] = ()

    @property
    def filled(self) -> tuple[str, ...]:
        """Parameters that are no options."""
        return self.given + self.offered


KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("video", "register_video_readers", "video reader"),
        Kind("pose", "register_pose_backends", "pose backend", ("model",)),
        Kind("reader", "register_keypoint_readers", "keypoint reader", (), ("options", "people")),
        Kind("normalizer", "register_normalizers", "normalizer"),
        Kind("filter", "register_filters", "filter"),
        Kind("selector", "register_selectors", "dimension selector"),
        Kind("kernel", "register_distance_kernels", "distance kernel"),
        Kind(
            "classifier",
            "register_classifiers",
            "classifier",
            (),
            ("neighbors", "sharpness", "shrinkage", "mirror"),
        ),
        Kind("writer", "register_result_writers", "result writer"),
        Kind("engine", "register_engines", "execution engine", ("workers", "limits")),
    )
}


class Register(Protocol):
    """The function that a hook receives."""

    def __call__(
        self,
        name: str,
        target: str,
        *,
        needs: Sequence[str] = (),
        extra: str = "",
        summary: str = "",
        suffixes: Sequence[str] = (),
        folders: bool = False,
        channels: bool = False,
    ) -> None:
        """Announce a plugin without importing it.

        Parameters
        ----------
        name : str
            What users write: lower-case letters, digits and hyphens.
        target : str
            ``"package.module:Class"``, imported when the name is first used.
        needs : sequence of str
            Modules that the target imports and that may be missing.
        extra : str
            What to ``pip install`` when one of them is.
        summary : str
            One line for `gesture plugins`.
        suffixes : sequence of str
            Of a keypoint reader: what the names of its files end in, such as ``.csv``; without any, it is
            asked about every file that is no video. Of a pose backend: the networks that it reads, such as
            ``.onnx``; without any, ``pose.backend = "auto"`` never takes it.
        folders : bool
            Of a keypoint reader: a folder of files may be one input.
        channels : bool
            Of a keypoint reader: what it reads are no people, but a `Recording` of channels; it is asked only
            where ``signals.input`` is ``channels``, and others only where it is not.
        """


@hookspec
def register_video_readers(register: Register) -> None:
    """Decoders of video files (`VideoReader`)."""


@hookspec
def register_pose_backends(register: Register) -> None:
    """Networks or services that find people in pictures (`PoseBackend`)."""


@hookspec
def register_keypoint_readers(register: Register) -> None:
    """Readers of ready-made keypoint files (`KeypointReader`)."""


@hookspec
def register_normalizers(register: Register) -> None:
    """From pixels to the body's own coordinates (`Normalizer`)."""


@hookspec
def register_filters(register: Register) -> None:
    """Steps of the signal chain (`Filter`)."""


@hookspec
def register_selectors(register: Register) -> None:
    """Choice of the salient dimensions (`Selector`)."""


@hookspec
def register_distance_kernels(register: Register) -> None:
    """Batched warping distances (`DistanceKernel`)."""


@hookspec
def register_classifiers(register: Register) -> None:
    """From distances, or the signals themselves, to scores of the classes (`Classifier`)."""


@hookspec
def register_result_writers(register: Register) -> None:
    """File formats of `gesture export` (`ResultWriter`)."""


@hookspec
def register_engines(register: Register) -> None:
    """Where extraction runs (`ExecutionEngine`)."""
