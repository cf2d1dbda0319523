"""Files and addresses: text, JSON, CSV, tables and arrays, read with one line for what is wrong."""
