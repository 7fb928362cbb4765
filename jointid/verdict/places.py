"""Places of a remedy: in the app, and in the files of a study."""

IMPORT = 'on the page "Import a log"'
"""Where columns, units, sides, runs, inertias and poses are entered."""
RUNS = f'under "Correct the runs" {IMPORT}'
ENTRIES = f'under "All entries" {IMPORT}'
INERTIAS = f'under "The robot" {IMPORT}'
FILE = "in study.toml"
