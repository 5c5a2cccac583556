"""Everything that may crash, hang or exceed its memory: named functions, called in worker processes.

A run is calls of the functions in `worker.FUNCTIONS`: try a model, ask a reader, extract keypoints, take an
example, fit, decide, write rows. Both engines of the package (`engines`) call the same table: ``processes``
hands tasks to worker processes (`worker` is what runs in one), ``inline`` calls them in this process.
An input whose task ends its process is tried once more, alone in a new process; then it gets a row that
says so.

Tasks and outcomes cross the pipe as JSON, one line each, so that nothing a worker says is ever unpickled:
a plugin or a decoder that has been taken over can say wrong things, but run nothing here. That is why
`concurrent.futures`, loky and pebble, which all pickle, were not taken. Processes are started afresh, never
forked: threads of numeric libraries are never copied, and a script needs no ``__main__`` guard.
"""
