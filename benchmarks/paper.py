"""Table 2 of the paper beside ours: 168 queries of the published keypoints, four values of t_var.

    python benchmarks/paper.py [--shared FOLDER] [--kernel NAME]

`paper-script` repeats what the authors' program did. It depends on the order of the examples,
because the query is overwritten and so smoothed once more for every further example; that belongs
here, not into the product. `paper` is the preset of that name: what the text of the paper says.
"""

from __future__ import annotations

import csv
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from datasets import PAPER_EXAMPLES, Item, arguments, need, utd_openpose, utd_skeleton

from gesture_core.classify.estimator import GestureClassifier
from gesture_core.dtw.distances import warping_distances
from gesture_core.dtw.spec import DtwSpec
from gesture_core.settings import Settings, load_settings
from gesture_core.signals.chain import Chain

THRESHOLDS = (0.05, 0.10, 0.15, 0.20)
PRINTED = ("72.0 %", "77.4 %", "74.4 %", "76.2 %")
EXPECTED = {"paper-script": (121, 130, 128, 128), "paper": (110, 129, 127, 125)}


@dataclass(frozen=True)
class Script:
    """The authors' program: selection by a median of 3, absolute cost, mean over dimensions."""

    t_var: float
    kernel: str = "auto"

    def salient(self, values: np.ndarray) -> np.ndarray:
        """(D,) channels whose variance exceeds ``t_var`` after a zero-padded median filter of 3 frames."""
        from scipy.signal import medfilt

        return np.array([medfilt(channel, 3).var() > self.t_var for channel in values.T])

    def distances(self, query: np.ndarray, examples: list[np.ndarray]) -> np.ndarray:
        """(N,) distances; the query changes from example to example, as in the program."""
        from scipy.ndimage import gaussian_filter1d

        query = query.copy()
        out = []
        for example in examples:
            chosen = self.salient(query) | self.salient(example)
            centred = gaussian_filter1d(example[:, chosen] - example[:, chosen].mean(axis=0), 1, axis=0)
            query[:, chosen] = gaussian_filter1d(query[:, chosen], 1, axis=0)
            own = query[:, chosen] - query[:, chosen].mean(axis=0)
            out.append(warping_distances([own], [centred], DtwSpec(), self.kernel)[0, 0])
        return np.array(out)


def script_predictions(queries: list[Item], examples: list[Item], t_var: float, kernel: str) -> list[str]:
    """The example that the authors' program finds nearest to each query."""
    script = Script(t_var, kernel)
    series = [item.exact for item in examples]
    return [examples[int(script.distances(q.exact, series).argmin())].name for q in queries]


def preset_predictions(queries: list[Item], examples: list[Item], settings: Settings) -> list[str]:
    """The nearest example of each query under a preset."""
    # The paper counts a query in which nothing moves enough; the product calls it E_NO_SALIENT.
    chain = replace(Chain.from_settings(settings), allow_still=True)
    classifier = GestureClassifier(settings)
    classifier.fit([chain(e.pose) for e in examples], [e.label for e in examples])
    _, near = classifier.kneighbors([chain(q.pose) for q in queries], 1)
    return [examples[int(i)].name for i in near[:, 0]]


def at(settings: Settings, t_var: float, kernel: str) -> Settings:
    """``settings`` with another variance threshold and kernel."""
    settings = settings.with_values([("variance.t_var", t_var)])
    return replace(settings, classify=replace(settings.classify, kernel=kernel))


def correct(queries: list[Item], names: list[str]) -> int:
    """How many queries have the label of the example that was found."""
    return sum(q.label == name.split("_")[0] for q, name in zip(queries, names, strict=True))


def authors_choice(shared: Path) -> dict[str, str]:
    """The nearest example of each query in the authors' own result file."""
    path = need(shared / "data" / "utd_openpose") / "authors_result.csv"
    with path.open(newline="") as file:
        return {clip(query): clip(example) for query, example in csv.reader(file)}


def clip(path: str) -> str:
    """``a1_s2_t1`` of ``poseCSVs/a1_s2_t1_color.avi.csv``."""
    return Path(path).name.removesuffix("_color.avi.csv")


def a8_table(shared: Path, paper: Settings) -> None:
    """The a8 column on the Kinect joints of subjects 1 to 4, with and without it."""
    actions = ("a1", "a6", "a7", "a8", "a9", "a24", "a26")
    items = [item for item in utd_skeleton(shared) if item.label in actions]
    print("\nKinect joints (x, y) of subjects 1 to 4, examples: the medoids of subject 1, preset paper")
    for chosen in (tuple(a for a in actions if a != "a8"), actions):
        kept = [item for item in items if item.label in chosen]
        examples = [i for i in kept if i.subject == "s1"]
        queries = [i for i in kept if i.subject != "s1"]
        found = []
        for t_var in THRESHOLDS:
            settings = at(paper, t_var, "auto")
            settings = replace(settings, classify=replace(settings.classify, representative=True))
            found.append(correct(queries, preset_predictions(queries, examples, settings)))
        print(f"  {' '.join(chosen):<26} {'  '.join(f'{f}/{len(queries)}' for f in found)}")


def main() -> int:
    """Print the table; the exit code says whether it is what was expected."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--kernel", default="auto")
    given = parser.parse_args()
    items = {item.name: item for item in utd_openpose(given.shared)}
    examples = [items[name] for name in PAPER_EXAMPLES]
    queries = [item for item in items.values() if item.subject != "s1"]
    paper = load_settings("paper")
    choice = authors_choice(given.shared)
    print(f"{len(queries)} queries, {len(examples)} examples\n")
    print(f"{'t_var':<6} {'printed':>8} {'paper-script':>18} {'as authors':>11} {'paper':>18}")
    whole = True
    for index, t_var in enumerate(THRESHOLDS):
        script = script_predictions(queries, examples, t_var, given.kernel)
        text = preset_predictions(queries, examples, at(paper, t_var, given.kernel))
        counts = {"paper-script": correct(queries, script), "paper": correct(queries, text)}
        same = sum(choice[q.name] == name for q, name in zip(queries, script, strict=True))
        whole &= all(counts[key] == EXPECTED[key][index] for key in counts)
        whole &= t_var != 0.10 or same == len(queries)
        cells = [f"{n}/{len(queries)} {100 * n / len(queries):5.1f} %" for n in counts.values()]
        print(f"{t_var:<6} {PRINTED[index]:>8} {cells[0]:>18} {same:>7}/{len(queries)} {cells[1]:>18}")
    print(f"\n{'as expected' if whole else 'NOT as expected'}: {EXPECTED}")
    a8_table(given.shared, paper)
    return 0 if whole else 1


if __name__ == "__main__":
    sys.exit(main())
