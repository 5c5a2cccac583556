"""Built-in normalizers, filters and dimension selectors."""
