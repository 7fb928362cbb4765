"""jointid app."""

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from jointid.cli.program import reported
from jointid.errors import JointIdError
from jointid.files.application import application_folder


@reported
def start_app(
    port: Annotated[int, typer.Option(min=1, max=65535, help="TCP port.")] = 8501,
    path: Annotated[
        Path | None, typer.Option(help="app.py to start in place of the installed one.")
    ] = None,
) -> None:
    """Start the app in the browser."""
    script = (path or application_folder() / "app.py").resolve()
    if not script.is_file():
        remedy = "Give --path an existing app.py, or leave it out." if path else "Install jointid again."
        raise JointIdError(f"{script} does not exist. {remedy}")
    # Streamlit reads .streamlit/config.toml beside the script as well as in the current folder.
    command = [sys.executable, "-m", "jointid.ui.server", str(script), str(port)]
    try:
        code = subprocess.run(command, cwd=script.parent, check=False).returncode
    except KeyboardInterrupt:
        return
    if code:
        raise JointIdError(f"The app ended with code {code}; see the message of the server above.")
