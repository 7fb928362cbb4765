"""python -m jointid: the command line."""

from jointid.cli import app

app()
