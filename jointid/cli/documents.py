"""JSON documents that several commands print."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jointid.study import Study


def study_document(study: Study, path: Path) -> dict[str, Any]:
    """Contents of a new study."""
    from jointid.files.digest import study_digest

    return {
        "study": str(path),
        "digest": study_digest(study),
        "joints": study.inertia.n,
        "records": [
            {
                "label": r.label,
                "frequency_hz": r.frequency_hz,
                "periods": r.periods,
                "samples": int(r.time_s.size),
            }
            for r in study.records
        ],
    }
