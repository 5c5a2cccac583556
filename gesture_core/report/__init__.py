"""Tables, plots, pages and overlays."""
