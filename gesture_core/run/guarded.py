"""Decides in a process that may die: what third-party plugins do to it costs one input, never the run."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from gesture_core.errors import ConfigError, GestureError, PluginError
from gesture_core.plugin import registry
from gesture_core.plugin.registry import Registration
from gesture_core.run.child import MEMORY
from gesture_core.run.deciding import Arrived, Decided, Decider, Deciding, Example
from gesture_core.run.run import keypoint_store
from gesture_core.run.sandbox import Sandbox, SandboxDeath
from gesture_core.settings import Settings
from gesture_core.types import PoseSequence, Prediction

_TOGETHER = 16


def decider(settings: Settings, sandbox: Sandbox | None) -> Deciding:
    """What decides under ``settings``: in the sandbox where a third party's plugin takes part, else here."""
    foreign = [entry for entry in deciding_plugins(settings) if not entry.origin.built_in]
    return GuardedDecider(settings, foreign, sandbox) if foreign and sandbox else Decider(settings)


def deciding_plugins(settings: Settings) -> list[Registration]:
    """The plugins that take part after the extraction: the chain, and the kernel unless it is ``auto``."""
    return [registry().find(kind, name.partition(":")[0]) for kind, name in settings.plugins()]


class GuardedDecider:
    """Decides in a sandbox, which is given its examples again after each death.

    Parameters
    ----------
    settings : Settings
    foreign : sequence of Registration
        The plugins that may be to blame, for messages.
    sandbox : Sandbox
    """

    def __init__(self, settings: Settings, foreign: Sequence[Registration], sandbox: Sandbox) -> None:
        self._settings = settings
        titles: dict[str, list[str]] = {}
        for entry in foreign:
            titles.setdefault(str(entry.origin), []).append(entry.title)
        self._suspects = " or ".join(f"{' or '.join(named)} of {o}" for o, named in titles.items())
        self._sandbox = sandbox
        self._examples: list[Example] = []
        self._fitted = False
        self._process = 0

    def check(self) -> None:
        """A GestureError where the settings name plugins that cannot be used."""
        self._twice(self._prepare)

    def add(self, example: Example, people: Sequence[PoseSequence]) -> None:
        """Take the first person of an example; a GestureError says why that cannot be."""
        self._twice(lambda: self._ask("example", example=asdict(example)))
        self._examples.append(example)

    def fit(self) -> None:
        """All examples are there; a PluginError where that cannot be survived."""
        self._twice(lambda: self._ask("fit"))
        self._fitted = True

    def predict(self, batch: Sequence[Arrived]) -> list[Decided]:
        """What is decided about each input of a batch; in case of a death, of each alone."""
        decided = []
        for start in range(0, len(batch), _TOGETHER):
            some = batch[start : start + _TOGETHER]
            try:
                decided += self._predict(some)
            except ConfigError:
                raise
            except GestureError:
                decided += [self._alone(one) for one in some]
        return decided

    def _alone(self, one: Arrived) -> Decided:
        try:
            return self._predict([one])[0]
        except ConfigError:
            raise
        except GestureError as error:
            died = isinstance(error, SandboxDeath)
            said = self._blamed(error) if isinstance(error, PluginError) else error
            failed = Prediction(None, "error", code=said.code, message=said.message)
            return Decided((failed,) * len(one.people), attempts=2 if died else 1)

    def _predict(self, batch: Sequence[Arrived]) -> list[Decided]:
        answers = self._ask("predict", batch=[(one.name, one.stored) for one in batch])
        return [Decided(tuple(self._prediction(tree) for tree in trees)) for trees in answers]

    def _ask(self, what: str, **arguments: Any) -> Any:
        self._prepare()
        return self._sandbox.ask(what, **arguments)

    def _prepare(self) -> None:
        """Bring a new process to where the last one was."""
        self._sandbox.start()
        if self._process == self._sandbox.started:
            return
        started = self._sandbox.started
        store = os.fsencode(keypoint_store()).hex()
        self._sandbox.ask("open", settings=self._settings.as_dict(), store=store)
        for example in self._examples:
            self._sandbox.ask("example", example=asdict(example))
        if self._fitted:
            self._sandbox.ask("fit")
        self._process = started

    def _twice(self, action: Callable[[], None]) -> None:
        try:
            action()
        except SandboxDeath:
            try:
                action()
            except SandboxDeath as death:
                raise self._blamed(death) from death

    def _blamed(self, death: GestureError) -> PluginError:
        return PluginError(
            f"{self._suspects}: {death.cause}", kept="the keypoints", remedy=death.remedy, code=death.code
        )

    def _prediction(self, tree: dict[str, Any]) -> Prediction:
        if tree["code"] == MEMORY:
            tree["message"] = f"{self._suspects}: {tree['message']}"
        neighbors = tuple((name, label, distance) for name, label, distance in tree["neighbors"])
        return Prediction(**{**tree, "neighbors": neighbors, "selected": tuple(tree["selected"])})
