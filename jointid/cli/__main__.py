"""python -m jointid.cli."""

from jointid.cli import app

app()
