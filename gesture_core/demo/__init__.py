"""An archive that the package draws itself: `motions` move a `figure`, `drawing` paints it, `archive` writes it."""
