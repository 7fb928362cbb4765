"""Objects of an HDF5 file, confined to that file.

HDF5 can take a dataset's values from any file of the computer: by external storage, a virtual dataset or
an external link. Every object is therefore looked up here, and refused before its shape or values are.
"""

from __future__ import annotations

from typing import Any

from jointid.errors import JointIdError
from jointid.importing.read.optional_imports import import_optional


def own_object(file: str, group: Any, key: Any) -> Any:
    """Return the object that a group holds under a name.

    Parameters
    ----------
    file : str
        Name of the file, for messages.
    group : h5py.Group
    key : str, bytes or h5py.Reference
        A name in the group (bytes where it is no UTF-8), or a reference to any object of its file.

    Returns
    -------
    h5py.Group, h5py.Dataset, h5py.Datatype or None
        None where there is nothing, or a soft link: a second name of an object that the file holds under
        another name, or a way through an external link.

    Raises
    ------
    JointIdError
        When it is a link to another file, or a dataset whose values lie in one or need a plugin.
    """
    h5py = import_optional("h5py", "h5py", "HDF5 files and MATLAB files of version 7.3")
    if not isinstance(key, h5py.Reference):
        try:
            link = group.get(key, getlink=True)
        except TypeError:  # user-defined link
            link = h5py.ExternalLink("", "/")
        if isinstance(link, h5py.ExternalLink):
            raise _elsewhere(file, f"{group.name.rstrip('/')}/{key}", "is a link to another file")
        if not isinstance(link, h5py.HardLink):
            return None
    item = group[key]
    if isinstance(item, h5py.Dataset):
        created = item.id.get_create_plist()
        if created.get_external_count() > 0:
            raise _elsewhere(file, item.name, "keeps its values in external files")
        # Its sources may be virtual or external again, those in this file too.
        if created.get_layout() == h5py.h5d.VIRTUAL:
            raise _elsewhere(file, item.name, "is a virtual dataset")
        for k in range(created.get_nfilters()):
            code, _, _, label = created.get_filter(k)
            if not h5py.h5z.filter_avail(code):
                raise JointIdError(
                    f'{file}: "{item.name!s:.200}" is packed with filter {code} '
                    f"({label.decode(errors='replace'):.40}), which this HDF5 does not have. "
                    "Save it with gzip compression, or without."
                )
    return item


def _elsewhere(file: str, name: object, fault: str) -> JointIdError:
    return JointIdError(
        f'{file}: "{name!s:.200}" {fault}. A log must hold all its values itself: copy them into an '
        "ordinary dataset of the file, or export it as CSV."
    )
