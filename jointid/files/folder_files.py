"""A folder as a safe read-only set of named bytes: links out of it and pipes are refused."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jointid.errors import JointIdError
from jointid.files.container_limits import Budget, is_clutter, missing, require_few_files, safe_name


class Folder:
    """A folder of files.

    Parameters
    ----------
    path : Path
        An existing folder.
    """

    def __init__(self, path: Path) -> None:
        self.name = path.name or str(path)
        self._root = path.resolve()
        self._budget = Budget(self.name)

    def names(self) -> tuple[str, ...]:
        """Return the names of all files at any depth, sorted."""
        found: list[str] = []
        for folder, folders, files in os.walk(self._root):
            folders.sort()
            found += [Path(folder, file).relative_to(self._root).as_posix() for file in files]
            require_few_files(self.name, len(found))
        return tuple(sorted(name for name in found if not is_clutter(name)))

    def read(self, name: str, *, at_most: int | None = None) -> bytes:
        """Return a file's bytes, all of them or the first ``at_most``."""
        with self._readable(name) as target, target.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            wanted = size if at_most is None else min(size, at_most)
            self._budget.spend(wanted, name)
            return file.read(wanted)

    def path(self, name: str) -> Path:
        """Return a file's path, for reading in parts."""
        with self._readable(name) as target:
            return target

    @contextmanager
    def _readable(self, name: str) -> Iterator[Path]:
        name = safe_name(name)
        try:
            target = (self._root / name).resolve(strict=True)
            if not target.is_relative_to(self._root):
                raise JointIdError(
                    f"{name} is a link that leaves {self.name}: put the file itself into the folder.",
                    file=name,
                )
            if not target.is_file():  # a pipe or device could block forever
                raise JointIdError(
                    f"{name} in {self.name} is no ordinary file: put the file itself into the folder.",
                    file=name,
                )
            yield target
        except (FileNotFoundError, NotADirectoryError):
            raise missing(name, self) from None
        except (OSError, RuntimeError) as error:
            raise JointIdError(
                f"{name} in {self.name} cannot be read: {error!s:.200}. Check its permissions.",
                file=name,
            ) from error
