"""A pose network is tried on a known picture, in a process that may die of it, before it meets an archive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gesture_core.errors import ModelError, PoseError, RunFolderError
from gesture_core.files import cache_dir, tree_sha256
from gesture_core.plugin import registry
from gesture_core.plugin.interfaces import PoseBackend
from gesture_core.pose.models import find_model
from gesture_core.run.run import keypoint_store
from gesture_core.run.work import Job, Task
from gesture_core.settings import Settings
from gesture_core.skeletons import skeleton


def require_model(settings: Settings, identity: Mapping[str, Any], engine: str = "processes") -> None:
    """Try the network that ``settings`` name; what passed once is not tried again.

    Parameters
    ----------
    settings : Settings
    identity : mapping
        From `fingerprint.pose_identity`.
    engine : str
        The execution engine whose worker tries it.

    Raises
    ------
    ModelError
        Where it cannot be loaded, kills its process, or answers with anything but keypoints.
    RunFolderError
        ``E_STORE_WRITE`` where the cache cannot be written.
    """
    mark = cache_dir() / "probed" / tree_sha256(identity["video"])[:32]
    if mark.exists():
        return
    try:
        mark.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(
            f"the cache cannot be written: {error.strerror or error}",
            subject=str(cache_dir()),
            remedy="its permissions, or another folder in GESTURE_CACHE",
            code="E_STORE_WRITE",
        ) from error
    model = find_model(settings.pose.model)
    runner = registry().make(
        "engine", engine, settings.plugin_options(engine), workers=1, limits=settings.limits
    )
    job = Job(settings, keypoint_store(), {}, 1)
    outcomes = list(runner.run(job, [Task(0, model.path, "probe")], lambda task, count: None))
    if hasattr(runner, "close"):
        runner.close()
    for outcome in outcomes:
        if outcome.code:
            raise ModelError(
                f"fails on a known picture: {outcome.code} {outcome.message}",
                subject=str(model.path),
                remedy="another --model or --pose; 'gesture models' lists them",
                code="E_MODEL_PROBE",
            )
    mark.touch()


def probe(backend: PoseBackend) -> None:
    """Run ``backend`` twice on a drawn person; a PoseError says what is wrong with its answer."""
    from gesture_core.demo.drawing import backdrop_of, draw
    from gesture_core.demo.figure import joints, random_body
    from gesture_core.demo.motions import GESTURES, Style

    size = (320, 240)
    rng = np.random.default_rng(0)
    body = random_body(rng, size)
    points = joints(body, *GESTURES["wave"](Style(9)), rng)
    picture = draw(body, points[4], backdrop_of(body, size, rng))
    answers = [backend.estimate([picture]) for _ in range(2)]
    width = len(skeleton(backend.skeleton).joints)
    for answer in answers:
        if len(answer) != 1:
            raise PoseError(f"answered with {len(answer)} pictures for one", code="E_MODEL_PROBE")
        for person in answer[0]:
            if np.shape(person.keypoints) != (width, 2) or np.shape(person.scores) != (width,):
                raise PoseError(
                    f"keypoints {np.shape(person.keypoints)} and scores {np.shape(person.scores)} "
                    f"for {width} joints",
                    code="E_MODEL_PROBE",
                )
            if np.isinf(person.keypoints).any() or not np.isfinite(person.scores).all():
                raise PoseError("infinite keypoints or scores", code="E_MODEL_PROBE")
    first, second = (np.array([p.keypoints for p in answer[0]]) for answer in answers)
    if first.shape != second.shape or not np.allclose(first, second, atol=0.01, equal_nan=True):
        raise PoseError("two answers to one picture differ", code="E_MODEL_PROBE")
