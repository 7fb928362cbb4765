"""jointid app."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from jointid.cli.program import reported
from jointid.errors import JointIdError


@reported
def start_app(
    port: Annotated[int, typer.Option(min=1, max=65535, help="TCP port.")] = 8501,
    path: Annotated[
        Path | None, typer.Option(help="Another app.py than the one of the checkout.")
    ] = None,
) -> None:
    """Start the app in the browser."""
    script = (path or Path(__file__).resolve().parents[2] / "app.py").resolve()
    if not script.is_file():
        raise JointIdError(
            f"{script} is not there. The app stands beside the package in a checkout of the source: "
            "install with pip install -e, or name it with --path."
        )
    command = [sys.executable, "-m", "streamlit", "run", str(script), f"--server.port={port}"]
    try:
        code = subprocess.run(command, cwd=script.parent, check=False).returncode
    except KeyboardInterrupt:
        return
    if code:
        raise JointIdError(f"The app ended with code {code}; what streamlit wrote above says why.")
