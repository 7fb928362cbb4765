"""Serve the app: ``python -m jointid.ui.server app.py 8501``."""

import os
import sys
from pathlib import Path

# A watcher polls every module for every session.
os.environ.setdefault("STREAMLIT_SERVER_FILE_WATCHER_TYPE", "none")

from jointid.ui.server.serving import serve

serve(str(Path(sys.argv[1]).resolve()), int(sys.argv[2]))
