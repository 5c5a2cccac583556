"""An execution engine of gesture-core on Ray."""
