"""Figures for publication: `drawing` makes them with matplotlib from the report's data, `writing` writes the files."""
