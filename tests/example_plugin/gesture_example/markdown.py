"""A result writer: a table for a report."""

from gesture_core.files import replacing


class MarkdownWriter:
    """Input, label, distance and status of every row."""

    suffix = ".md"
    columns = ("input", "label", "distance", "status")

    def write(self, rows, columns, path):
        """Write ``rows`` to ``path``, whole or not at all."""
        with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
            file.write("| " + " | ".join(self.columns) + " |\n" + "|---" * len(self.columns) + "|\n")
            for row in rows:
                cells = ["" if row[name] is None else str(row[name]) for name in self.columns]
                file.write("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n")
