"""Pages that open without a network: sections, tables, Markdown and CSV files."""
