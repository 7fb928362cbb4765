"""Simultaneous users, each with a study of their own: no session shows data of another.

Twenty real browsers would load the machine more than the server, so the sessions speak its protocol.
"""

from __future__ import annotations

import random
import re
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from browsing import Server
from random_cases import tries
from sessions import Session

from jointid import Elasticity, Inertia, SineRecord, Study, motor_response
from jointid.files.digest import study_digest
from jointid.files.store import Store, new_workspace
from jointid.files.study_files import pack_study

pytestmark = pytest.mark.browser

PERSONS, PAGES_EACH = tries((8, 4), nightly=(20, 6))
PAGES = ("", "Records", "Phasors", "Transfer_matrix", "Elasticity")
METHODS = ("weighted", "least-squares", "explicit")
INERTIA = Inertia(M=[0.001], M2=[[0.004]])


def stiffness(person: int) -> float:
    return 20.0 + person


def study_of(person: int) -> Study:
    """One joint without noise, of a stiffness that only this person has."""
    elasticity = Elasticity(K=[stiffness(person)], D=[0.05])
    records = []
    for f in (4.0, 8.0, 12.0, 18.0):
        omega = 2 * np.pi * f
        time = np.arange(800) / 1000.0
        response = motor_response(np.array([omega]), INERTIA, elasticity)[0, 0, 0]
        tau = np.sin(omega * time)
        theta = np.imag(-response / omega**2 * np.exp(1j * omega * time))
        records.append(
            SineRecord(frequency_hz=f, time_s=time, theta_rad=theta[:, None], tau_Nm=tau[:, None])
        )
    return Study(records, INERTIA, name=f"Cell of person {person}", origin="simulated")


@pytest.fixture(scope="module")
def crowd(new_server: Callable[[], Server]) -> Iterator[list[tuple[Session, str]]]:
    """Sessions of one server, and the address that each comes from."""
    server, sessions = new_server(), []
    try:
        store = Store(server.data)
        for person in range(PERSONS):
            study, place = study_of(person), new_workspace()
            entry = store.put(place, f"p{person}.zip", study_digest(study), pack_study(study))
            sessions.append((Session(server.address), f"w={place}&study={entry.digest}"))
        yield sessions
        for session, _ in sessions:
            session.close()
    finally:
        server.kill()


def test_each_session_shows_only_its_own_study(crowd: list[tuple[Session, str]]) -> None:
    together = threading.Barrier(PERSONS)

    def walk(person: int) -> list[tuple[str, str]]:
        session, query = crowd[person]
        order = random.Random(person)
        method = METHODS[person % len(METHODS)]
        session.run("", query)
        session.choose("Estimator", method)
        seen = []
        for _ in range(PAGES_EACH):
            together.wait(timeout=60)
            page = order.choice(PAGES)
            seen.append((page, str(session.run(page))))
        together.wait(timeout=60)
        seen.append(("Elasticity", str(session.run("Elasticity"))))
        assert query.split("&")[0] in session.query
        return seen

    with ThreadPoolExecutor(PERSONS) as threads:
        walks = list(threads.map(walk, range(PERSONS)))
    for person, seen in enumerate(walks):
        for page, text in seen:
            assert "exception {" not in text
            assert set(re.findall(r"p\d+\.zip", text)) == {f"p{person}.zip"}
            assert set(re.findall(r"Cell of person \d+", text)) <= {f"Cell of person {person}"}
            if page in ("", "Elasticity"):
                found = float(re.search(r'metric \{\s*label: "K1.*?"\s*body: "([\d.]+)', text)[1])  # type: ignore[index]
                assert found == pytest.approx(stiffness(person), rel=1e-3)
        assert f"**{METHODS[person % len(METHODS)]}**" in seen[-1][1]
    assert len({session.query for session, _ in crowd}) == PERSONS
