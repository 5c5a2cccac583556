"""A run: from sources and examples to the rows of a run folder, resumed where it stopped.

The way of a clip, a file each: `inputs` finds it (`readers` says whose keypoint file it is) and `labels`
names the examples; `plan` checks everything and says what is left to do (`fingerprint`: what decides a
result); `pipeline` does it: `extract` has the keypoints of each input brought into the `store`, and the
decision is made in a worker (`workers`); `rows` says what came of it, and `results` keeps it in ``run.db``.
`archive` has all of that as functions.

Beside the way: `manifests` and `label_tables` read lists, `keypoint_files` leaves what `gesture extract`
found, `export` writes rows as files. `evaluate` tests labelled inputs on each other (`protocol`: which on
which), `explain` and `cut` go back to the inputs of a run (`found_again`), `annotations` compares events
with marks.
"""
