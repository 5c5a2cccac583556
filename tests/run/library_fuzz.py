"""Breaks files of example libraries and pose networks, and holds what the run makes of them to its word.

`python library_fuzz.py` reads paths of networks, one a line, and prints what the probe says of each: the
disposable process that `benchmarks/soak_libraries.py` restarts where a runtime dies of a file.
"""

from __future__ import annotations

import io
import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gesture_core.errors import GestureError
from gesture_core.plugin import registry
from gesture_core.records import encoded
from gesture_core.run.inputs import discover
from gesture_core.run.labels import label_inputs
from gesture_core.run.store import Extracted, write_keypoints
from gesture_core.run.workers.keypoints import KeypointExtractor
from gesture_core.run.workers.worker import Worker
from gesture_core.settings import Settings, load_settings
from gesture_core.types import Job, PoseSequence, Task

_FRAMES = 12


def _pose() -> PoseSequence:
    rng = np.random.default_rng(3)
    points = rng.normal(300, 60, (_FRAMES, 18, 2)).round(2)
    points[2, 4] = np.nan
    return PoseSequence(points, np.ones((_FRAMES, 18)), np.arange(_FRAMES) / 20)


def library_files(folder: Path) -> dict[str, bytes]:
    """Healthy files of every kind that an example library may hold, by name."""
    pose = _pose()
    points = np.nan_to_num(pose.keypoints)
    whole = {"keypoints": points, "scores": pose.scores, "times": pose.times, "skeleton": np.array("coco18")}
    names = [f"{joint}_{axis}" for joint in ("nose", "neck", "left_wrist") for axis in "xy"]
    table = [",".join(["time", *names])] + [
        ",".join(map(str, [t / 20, *range(t, t + 6)])) for t in range(_FRAMES)
    ]
    write_keypoints(folder / "store.parquet", [pose], _facts())
    return {
        "own.npz": _npz(**whole),
        "many.npz": _npz(one=points, two=points + 3),
        "plain.npy": _npy(np.concatenate([points, pose.scores[..., None]], axis=2)),
        "bare.csv": "\n".join(",".join(map(str, row)) for row in points.reshape(_FRAMES, -1)).encode(),
        "named.csv": "\n".join(table).encode(),
        "store.parquet": (folder / "store.parquet").read_bytes(),
        "labels.csv": b"path,label\nwave/x.npz,wave\nstop/y.npz,stop\n",
    }


def model_files(folder: Path) -> dict[str, bytes]:
    """Healthy networks of the layouts that the pose backends know."""
    from tiny_networks import constant, dot_network, random_maps

    simcc = {"simcc_x": np.ones((1, 17, 128)), "simcc_y": np.ones((1, 17, 128))}
    made = (
        dot_network(folder / "dots.onnx"),
        dot_network(folder / "any.onnx", side=None, fields=True),
        random_maps(folder / "maps.onnx"),
        constant(folder / "simcc.onnx", simcc),
    )
    return {path.name: path.read_bytes() for path in made}


def check_library(folder: Path, name: str, data: bytes) -> str:
    """``ok`` or the code of the first input of an example folder that holds ``data`` as ``name``.

    An AssertionError says that something was neither read nor refused in words.
    """
    path = folder / "examples" / "wave" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    settings = load_settings("paper", environment={})
    keys = {f"reader {r}": r for r in registry().names("reader")}
    extractor = KeypointExtractor(
        Worker(Job(settings.as_dict(), str(folder / "store"), keys), lambda message: None)
    )
    try:
        if name == "labels.csv":
            discover([path])
            label_inputs(discover([path.parent]), str(path), [path.parent])
            return "ok"
        items = label_inputs(discover([folder / "examples"]), "folder", [folder / "examples"])
        codes = [item.code for item in items if item.kind == "broken"]
        assert all(item.fault and item.name for item in items if item.kind != "keypoints")
        for item in (i for i in items if i.kind == "keypoints"):
            outcome = Extracted.from_tree(extractor.extract(encoded(item.path), item.member, item.reader))
            assert outcome.code != "E_PLUGIN_RAISED", outcome.message
            assert bool(outcome.stored) != bool(outcome.code) and bool(outcome.message) == bool(outcome.code)
            codes.append(outcome.code)
        kinds = {item.kind for item in items}
        return next(filter(None, codes), "ok" if "keypoints" in kinds else "skipped")
    except GestureError as error:
        assert error.code.startswith("E_") and error.cause
        return error.code
    finally:
        path.unlink()


def check_model(path: Path, settings: Settings) -> str:
    """``ok`` or the code of a network in a file, found, loaded and tried on a known picture."""
    settings = replace(settings, pose=replace(settings.pose, model=str(path)))
    worker = Worker(Job(settings.as_dict(), str(path.parent / "store")), lambda message: None)
    error = worker.perform(Task(0, "try_model")).error
    assert error is None or (error.code != "E_PLUGIN_RAISED" and error.cause), error
    return error.code if error else "ok"


def _facts() -> dict[str, object]:
    facts = {"frames_declared": _FRAMES, "frames_read": _FRAMES, "complete": True, "seconds": 0.55}
    return {**facts, "notes": [], "people": 1}


def _npz(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def _serve() -> None:
    replies = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a runtime prints
    settings = load_settings("paper", environment={})
    for line in sys.stdin:
        try:
            answer = check_model(Path(line.rstrip("\n")), settings)
        except Exception as error:  # noqa: BLE001 - whatever is not typed is what is looked for
            answer = f"untyped {type(error).__name__}: {error}"
        print(json.dumps(answer), file=replies, flush=True)


if __name__ == "__main__":
    _serve()
