"""Files and addresses: text, JSON, CSV, tables and arrays, with one-line errors."""
