"""Checks for URDF and MJCF; each error names the file and the element."""

from collections import Counter
from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np

from jointid.errors import JointIdError
from jointid.parsing.checked_xml import require_numbers
from jointid.robot_models.rigid_bodies import RigidBodies
from jointid.wording import counted

_MOST_JOINTS = 64


def require_unique(file: str, parts: list[Element]) -> None:
    """Refuse two elements of one name."""
    for name, count in Counter(part.get("name") for part in parts).items():
        if name is not None and count > 1:
            raise xml_error(
                file, f'two elements <{parts[0].tag}> have the name "{name:.60}": rename one.'
            )


def require_numeric(file: str, root: Element, known: dict[str, dict[str, range]]) -> None:
    """Refuse attributes that are not numbers, and negative masses."""
    for owner in root.iter():
        for part in owner:
            for key, count in known.get(part.tag, {}).items():
                if (text := part.get(key)) is None:
                    continue
                name = part.get("name") or owner.get("name") or ""
                place = f"<{part.tag}> of {name}, {key}" if name else f"<{part.tag}>, {key}"
                values = require_numbers(file, place, text, count)
                if (key in ("mass", "density", "armature") or part.tag == "mass") and values[0] < 0:
                    raise xml_error(file, f"{place} = {values[0]:g}: it must not be negative.")
                if key in ("axis", "quat", "zaxis") and not any(values):
                    raise xml_error(file, f"{place} is zero: give a direction.")


def require_physical(file: str, names: Sequence[str], links: RigidBodies) -> None:
    """Refuse inertias that no rigid body can have."""
    for name, tensor in zip(names, links.inertia, strict=True):
        if not np.isfinite(tensor).all():
            raise xml_error(
                file,
                f"the bodies moved by joint {name} have an infinite or undefined inertia: check the "
                "sizes and masses of their shapes.",
            )
        moments = np.linalg.eigvalsh(tensor)
        if moments[0] < -1e-6 * np.abs(moments).max():
            raise xml_error(
                file,
                f"the bodies moved by joint {name} have the negative principal moment {moments[0]:g} "
                "kg·m²: check its inertias.",
            )


def require_joints(file: str, count: int) -> None:
    """Refuse a robot without joints, or with too many."""
    if not 1 <= count <= _MOST_JOINTS:
        raise xml_error(
            file, f"the robot has {counted(count, 'moving joint')}: 1 to {_MOST_JOINTS} are supported."
        )


def xml_error(file: str, message: str) -> JointIdError:
    """Error that names the file."""
    return JointIdError(f"{file}: {message}", file=file)
