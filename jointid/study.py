"""A study: the records of one robot, what is known about it, and the whole method on one screen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from jointid.errors import JointIdError
from jointid.joints import Elasticity, Inertia
from jointid.records import SineRecord


@dataclass(frozen=True, eq=False)
class Study:
    """Sine records of one robot, with the rigid-body inertias the method takes as known.

    Parameters
    ----------
    records : sequence of SineRecord
        At least one; all with the joints of ``inertia``.
    inertia : Inertia
        Motor side, for records without a pose.
    nominal : Elasticity, optional
        What the controller assumes today.
    name : str, default ""
    origin : {"", "simulated", "measured"}
        Where the records come from; empty when not stated.
    description : str, default ""
        A sentence or two for the reader.
    poses : mapping of str to Inertia, optional
        Inertia of each named pose.

    Raises
    ------
    JointIdError
        When a record's joints or pose do not fit, or there is no record.
    """

    records: tuple[SineRecord, ...]
    inertia: Inertia
    nominal: Elasticity | None = None
    name: str = ""
    origin: str = ""
    description: str = ""
    poses: Mapping[str, Inertia] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "records", tuple(self.records))
        object.__setattr__(self, "poses", MappingProxyType(dict(self.poses)))
        if not self.records:
            raise JointIdError("The study holds no records: add at least one sine experiment.")
        if self.origin not in ("", "simulated", "measured"):
            raise JointIdError(
                f'origin = "{self.origin}": expected "simulated" or "measured", or leave it out.'
            )
        for number, record in enumerate(self.records, start=1):
            where = record.label or f"record {number}"
            if record.n != self.inertia.n:
                raise JointIdError(
                    f"{where} has {record.n} joint(s), the study's inertia has {self.inertia.n}."
                )
            if record.pose is not None and record.pose not in self.poses:
                known = ", ".join(self.poses) or "none"
                raise JointIdError(
                    f'{where}: pose "{record.pose}" is not defined. Known poses: {known}.'
                )
        for what, joints in [("nominal", self.nominal), *self.poses.items()]:
            if joints is not None and joints.n != self.inertia.n:
                raise JointIdError(
                    f"{what} has {joints.n} joint(s), the study's inertia has {self.inertia.n}."
                )

    @property
    def inertias(self) -> Sequence[Inertia]:
        """The inertia that each record was measured with, by its pose."""
        return [self.inertia if r.pose is None else self.poses[r.pose] for r in self.records]
