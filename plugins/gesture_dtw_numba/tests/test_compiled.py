"""Compiled code is kept: for how many forms, and what becomes of a copy that cannot be read."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba")

import numba
from gesture_dtw_numba.layout import make_batch

from gesture_core.dtw.spec import DtwSpec
from gesture_core.types import SignalBatch

_BOUNDS = """
import numpy as np
from gesture_dtw_numba.kernel import NumbaKernel
low, high = np.zeros((1, 1, 3)), np.ones((1, 1, 3))
print(NumbaKernel().keogh(np.full((1, 3), 3.0), low, high, False).tolist())
"""


def bound(folder: Path) -> subprocess.CompletedProcess[str]:
    """Compute one lower bound, whose compiled code is kept in ``folder``."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder)}
    return subprocess.run(
        [sys.executable, "-c", _BOUNDS], env=environment, capture_output=True, text=True, check=True
    )


def test_a_copy_that_cannot_be_read_is_compiled_again_and_replaced(tmp_path: Path) -> None:
    first = bound(tmp_path)
    assert first.stdout.strip() == "[[6.0]]" and "compiling the distance kernel" in first.stderr
    assert bound(tmp_path).stderr == "", "it is kept, and nobody waits"
    (index,) = tmp_path.rglob("*.nbi")
    whole = index.read_bytes()
    renamed = pickle.dumps(numba.__version__) + b"cgesture_dtw_numba.layout\nOfAnotherName\n."
    for damaged in (renamed, whole[:-7], b""):
        index.write_bytes(damaged)
        again = bound(tmp_path)
        assert again.stdout == first.stdout and "compiling" in again.stderr
        assert bound(tmp_path).stderr == ""


def test_one_form_whatever_the_memory_of_a_batch_is_like() -> None:
    forms = set()
    for turn in (np.asfortranarray, np.ascontiguousarray):
        for writable in (True, False):
            values, masks = turn(np.zeros((2, 3, 4), np.float32)), turn(np.ones((2, 4), bool))
            batch = SignalBatch(values, np.array([3, 3]), masks, masks.copy(order="K"))
            for array in (batch.values, batch.lengths, batch.masks, batch.present):
                array.flags.writeable = writable
            made = make_batch(batch, DtwSpec())
            forms.add(tuple((a.dtype, a.flags.c_contiguous, a.flags.writeable) for a in made))
    assert len(forms) == 1
