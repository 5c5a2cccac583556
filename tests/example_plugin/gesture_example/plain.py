"""A distance kernel in twenty lines: hard, dependent DTW, one pair at a time."""

import numpy as np

from gesture_core.dtw.spec import DtwSpec


class PlainKernel:
    """Computes one kind of distance only, and says so in `supports`."""

    def supports(self, spec):
        """Whether ``spec`` is what this kernel computes."""
        plain = DtwSpec(mode="dependent", reduce="sum", cost=spec.cost)
        return spec == plain and spec.cost in ("absolute", "squared")

    def prepare(self, examples, spec):
        """Nothing is worth preparing, but for what a frame costs."""
        return examples, np.square if spec.cost == "squared" else np.abs

    def distances(self, state, queries):
        """(Q, N) distances."""
        examples, cost = state
        out = np.full((len(queries), len(examples)), np.inf)
        for q in range(len(queries)):
            for e in range(len(examples)):
                used = (queries.masks[q] | examples.masks[e]) & queries.present[q] & examples.present[e]
                if used.any():
                    a = queries.values[q, : queries.lengths[q], used].T
                    b = examples.values[e, : examples.lengths[e], used].T
                    out[q, e] = _warp(cost(a[:, None] - b[None]).sum(axis=2))
        return out


def _warp(cost):
    total = np.full((cost.shape[0] + 1, cost.shape[1] + 1), np.inf)
    total[0, 0] = 0
    for i in range(cost.shape[0]):
        for j in range(cost.shape[1]):
            best = min(total[i, j], total[i, j + 1], total[i + 1, j])
            total[i + 1, j + 1] = cost[i, j] + best
    return total[-1, -1]
