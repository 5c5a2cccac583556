"""``gesture review``: a person looks at the rows of a run and says what they are."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from gesture_core.cli.flags import UNSAID, Whole, Workers
from gesture_core.cli.output import check_file, check_folder, counted, say
from gesture_core.files import printable


def review(
    run: Path,
    /,
    *,
    export: Annotated[Path | None, UNSAID] = None,
    to_examples: Annotated[Path | None, UNSAID] = None,
    most: Annotated[Whole | None, UNSAID, Parameter(validator=validators.Number(gte=1))] = None,
    no_previews: Annotated[bool, UNSAID] = False,
    port: Annotated[Whole, UNSAID, Parameter(validator=validators.Number(gte=0, lte=65535))] = 0,
    workers: Workers = 0,
) -> None:
    """Look at the rows of a run, the least certain first, and say of each with one key what it is.

    The page of gesture report, served to this machine alone until Ctrl-C. Answers are kept in the run's
    database at once, beside what the machine said, never over it.

    Parameters
    ----------
    run
        The run folder.
    export
        Nothing is served: write the answers to a CSV file, which gesture classify takes among its examples.
    to_examples
        Nothing is served: put corrected clips into this folder of examples, by label; only those that the
        examples would still get wrong, the ones first that change most decisions.
    most
        With --to-examples: how many at most.
    no_previews
        No videos: the page is there at once.
    port
        Of the page; any that is free by default.
    """
    if export is not None or to_examples is not None:
        _use(run, export, to_examples, most)
        return
    from gesture_core.cli.progress import progress
    from gesture_core.report.review_server import ReviewServer
    from gesture_core.report.run_page import NO_ROWS, write_report
    from gesture_core.run.review import Answers

    with Answers(run) as answers, ReviewServer(answers, port) as server:
        with progress([str(run)]) as listener:
            done = write_report(
                run, run / "review", previews=not no_previews, workers=workers, listener=listener
            )
        if not done.rows:
            say(NO_ROWS)
        server.show(done.page.parent, done.labels)
        print(server.address, flush=True)
        say("open it in a browser; Ctrl-C ends it, and every answer is kept at once")
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            say(f"{counted(len(answers.given()), 'answer')} about {counted(done.rows, 'row')}")


def _use(run: Path, export: Path | None, to_examples: Path | None, most: int | None) -> None:
    from gesture_core.run.review import Answers, add_corrections, write_answers

    if export is not None:
        check_file(export, (".csv",), flag="--export")
        with Answers(run) as answers:
            answered = answers.answered()
        print(printable(write_answers(answered, export)))
        say(counted(len(answered), "answer"))
        if parts := sum(not one.whole for one in answered):
            say(
                f"{parts} about an event, a further person or one of several sequences: without a path, "
                "so that no label stands for all of the input; gesture cut makes clips of events"
            )
    if to_examples is not None:
        check_folder(to_examples, flag="--to-examples")
        found = add_corrections(run, to_examples, most=most)
        for path in found.added:
            print(printable(path))
        say(f"{counted(len(found.added), 'new example')}; {found.redundant} more would change nothing")
        for reason, number in found.left_out.items():
            say(f"{counted(number, 'answer')} left out: {reason}")
