"""Serve the app: ``python -m jointid.ui.server app.py 8501``."""

import sys
from pathlib import Path

from jointid.ui.server.serving import serve

serve(str(Path(sys.argv[1]).resolve()), int(sys.argv[2]))
