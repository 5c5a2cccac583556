"""How the project's own pose network is made: label, render, train, export, evaluate.

One command, from the root of the repository, runs every step that is not yet done, and goes on where it
was stopped::

    python -m training --shared ../shared --work .work/training

It needs the extra ``train``. Nothing here is imported by the package itself, or part of its wheel.
"""
