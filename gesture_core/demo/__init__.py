"""An archive that the package draws: `motions` move a `figure`, `drawing` paints it, `archive` writes it."""
