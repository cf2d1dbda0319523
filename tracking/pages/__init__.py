"""Pages that work offline: sections, tables, Markdown and CSV files."""
