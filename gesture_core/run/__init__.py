"""A run: from sources and examples to the rows of a run folder, resumed where it stopped.

The way of a clip, a file each: `inputs` finds it (`readers` says whose keypoint file it is) and `labels`
names the examples; `plan` checks everything and says what is left to do (`fingerprint`: what decides a
result); `pipeline` does it: `extract` has the keypoints of each input brought into the `store`, and the
decision is made in a worker (`workers`); `rows` says what came of it, and `results` keeps it in ``run.db``.
`archive` has all of that as functions.

Beside the way: `tables` reads lists, `export` writes rows and keypoints as files. `evaluate` tests labelled
inputs on each other, `explain`, `cut` and `find` go back to the inputs of a run (`found_again`),
`review` makes examples of what a person corrected, `annotations` compares events with marks, `watch` has no
run folder.
"""
