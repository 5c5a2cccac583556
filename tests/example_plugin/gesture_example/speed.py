"""A filter that adds channels: how fast each joint moves, whatever the direction."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class SpeedFilter:
    """Adds ``left_wrist.speed`` for ``left_wrist_x`` and ``left_wrist_y``, and so on.

    Attributes
    ----------
    weight : float
        Seconds by which a speed is multiplied, so that it counts as a position does.
    """

    weight: float = 0.1

    def apply(self, signals):
        """The signals with one more channel for each joint that has an x and a y."""
        places = {name: index for index, name in enumerate(signals.channels)}
        joints = [n.removesuffix("_x") for n in places if n.endswith("_x") and f"{n[:-1]}y" in places]
        x, y = ([places[f"{joint}_{axis}"] for joint in joints] for axis in "xy")
        steps = np.diff(signals.values, axis=0, prepend=signals.values[:1])
        seconds = (signals.times[-1] - signals.times[0]) / max(len(signals) - 1, 1) or 1.0
        speeds = np.hypot(steps[:, x], steps[:, y]) * (self.weight / seconds)
        return replace(
            signals,
            values=np.concatenate([signals.values, speeds], axis=1),
            # The side stays in front and the kind comes after a dot, as mirror and parts expect.
            channels=signals.channels + tuple(f"{joint}.speed" for joint in joints),
            mask=np.concatenate([signals.mask, signals.mask[x] | signals.mask[y]]),
            present=np.concatenate([signals.present, signals.present[x] & signals.present[y]]),
        )
