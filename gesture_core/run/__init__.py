"""A run: from sources and examples to the rows of a run folder, resumed where it stopped.

`inputs` and `labels` find what there is, `plan` checks it and says what is left to do (`fingerprint`: what
decides a result), `pipeline` does it: `extract` brings keypoints into the `store`, the decision is made in
a worker (`workers`), `rows` says what came of each input, and `results` keeps it. `export` writes the rows
as files. `archive` has all of that as two functions.
"""
