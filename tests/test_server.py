"""The server: stalled clients, closed sessions and malformed requests, without a browser."""

from __future__ import annotations

import base64
import os
import re
import socket
import time
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path

import pytest
from browsing import Server
from random_cases import tries
from sessions import Session

PATIENCE_S = 1.0
pytestmark = [
    pytest.mark.long,  # they wait; the browser's tests use servers as well
    pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="descriptors are read in /proc"),
]


@pytest.fixture(scope="module")
def server(tree: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("JOINTID_PATIENCE_S", str(PATIENCE_S))
        server = Server(tree, tmp_path_factory.mktemp("store"))
    yield server
    server.kill()


def descriptors(server: Server) -> int:
    return len(os.listdir(f"/proc/{server.process.pid}/fd"))


def connected(server: Server) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=20)


def ended_after(connection: socket.socket, trickle: Callable[[int], bytes] = lambda _: b"") -> float:
    """Patiences until the server ends a connection that sends a few bytes ten times per second."""
    begin = time.monotonic()
    connection.settimeout(0.1)
    for step in range(200):
        try:
            if trickle(step):
                connection.sendall(trickle(step))
            if not connection.recv(1 << 16):
                break
        except TimeoutError:
            continue
        except (ConnectionError, BrokenPipeError):
            break
    else:
        raise AssertionError("The server keeps this connection.")
    return (time.monotonic() - begin) / PATIENCE_S


@contextmanager
def visiting(server: Server) -> Iterator[Session]:
    with closing(Session(server.address)) as session:
        session.run("")
        yield session


def upload(server: Server, session: Session) -> bytes:
    """Head of an upload of 100 MB that the server accepts."""
    with urllib.request.urlopen(f"{server.address}/_stcore/health") as answer:
        (token,) = re.findall("_streamlit_xsrf=([^;]+)", answer.headers["Set-Cookie"])
    path = f"/_stcore/upload_file/{session.begun.initialize.session_id}/one"
    return (
        f"PUT {path} HTTP/1.1\r\nHost: x\r\nCookie: _streamlit_xsrf={token}\r\nX-Xsrftoken: {token}\r\n"
        "Content-Type: multipart/form-data; boundary=b\r\nContent-Length: 100000000\r\n\r\n"
        '--b\r\nContent-Disposition: form-data; name="file"; filename="log.csv"\r\n\r\n'
    ).encode()


def request_that_trickles_in(server: Server, before: bytes = b"") -> float:
    with connected(server) as connection:
        connection.sendall(before + b"GET / HTTP/1.1\r\nHost: x\r\n")
        return ended_after(connection, lambda step: b"X-%d: 1\r\n" % step)


def upload_that_stalls(server: Server, trickle: bytes) -> float:
    with visiting(server) as session, connected(server) as connection:
        connection.sendall(upload(server, session) + b"time,q\n" * 9000)
        return ended_after(connection, lambda _: trickle)


def upload_at_a_slow_network(server: Server) -> float:
    """Not ended for three patiences."""
    with visiting(server) as session, connected(server) as connection:
        connection.sendall(upload(server, session))
        for _ in range(15):
            connection.sendall(b"time,q\n" * 3000)
            time.sleep(0.2 * PATIENCE_S)
        connection.settimeout(0.1)
        with pytest.raises(TimeoutError):
            connection.recv(1)
    return 0.0


def client_that_takes_no_response(server: Server) -> float:
    """Share of the responses that it receives in the end."""
    with urllib.request.urlopen(server.address) as answer:
        (script,) = re.findall(r'src="\./(static/js/index[^"]+)"', answer.read().decode())
    with urllib.request.urlopen(f"{server.address}/{script}") as answer:
        every = 40 * len(answer.read())
    received = 0
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(("127.0.0.1", server.port))
        connection.sendall(f"GET /{script} HTTP/1.1\r\nHost: x\r\n\r\n".encode() * 40)
        time.sleep(3 * PATIENCE_S)
        with suppress(ConnectionError):
            while more := connection.recv(1 << 20):  # what the system kept for it
                received += len(more)
    return received / every


def websocket_without_pongs(server: Server) -> float:
    key = base64.b64encode(os.urandom(16)).decode()
    with connected(server) as connection:
        connection.sendall(
            "GET /_stcore/stream HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        return ended_after(connection)


def connection_without_request(server: Server) -> float:
    with connected(server) as connection:
        return ended_after(connection)


HEALTH = b"GET /_stcore/health HTTP/1.1\r\nHost: x\r\n\r\n"
CLIENTS: dict[str, tuple[Callable[[Server], float], float, float]] = {
    "connection without request": (connection_without_request, 0, 3),
    "request that trickles in": (request_that_trickles_in, 0, 3),
    "second request that trickles in": (partial(request_that_trickles_in, before=HEALTH), 0, 4),
    "upload that stops": (partial(upload_that_stalls, trickle=b""), 1, 4),
    "slow upload": (partial(upload_that_stalls, trickle=b"1,2,3\n"), 1, 4),
    "upload at a slow network": (upload_at_a_slow_network, -1, 1),
    "client that takes no response": (client_that_takes_no_response, 0, 0.5),
    "websocket without pongs": (websocket_without_pongs, 1, 5),
}
"""Clients, and between which figures the answer of each must be."""


def test_stalled_clients_are_disconnected(server: Server) -> None:
    """All clients at once: each waits for the time-out of the server."""
    with ThreadPoolExecutor(len(CLIENTS)) as pool:
        found = {name: pool.submit(client, server) for name, (client, _, _) in CLIENTS.items()}
    shown = {name: future.result() for name, future in found.items()}
    wrong = {name: shown[name] for name, (_, a, b) in CLIENTS.items() if not a < shown[name] < b}
    assert not wrong


def test_the_server_watches_no_files(server: Server) -> None:
    with visiting(server):
        links = [os.readlink(link) for link in Path(f"/proc/{server.process.pid}/fd").iterdir()]
    assert links
    assert "anon_inode:inotify" not in links


def test_uploads_are_bounded_over_a_session_and_over_all(monkeypatch: pytest.MonkeyPatch) -> None:
    from starlette.exceptions import HTTPException
    from streamlit.runtime.memory_uploaded_file_manager import MemoryUploadedFileManager
    from streamlit.runtime.uploaded_file_manager import UploadedFileRec

    from jointid.ui.server import serving

    monkeypatch.setattr(serving, "MOST_OF_SESSION", 300)
    monkeypatch.setattr(serving, "MOST_OF_ALL", 500)
    manager = MemoryUploadedFileManager("/upload")
    serving.bound_uploads(manager)
    held = 0
    for session in ("one", "two"):
        for number in range(4):
            with suppress(HTTPException):
                manager.add_file(session, UploadedFileRec(f"{number}", "x.csv", "", bytes(100)))
                held += 1
    assert held == 3 + 2
    manager.remove_session_files("one")
    manager.add_file("two", UploadedFileRec("9", "x.csv", "", bytes(100)))


def test_a_simulated_session_chooses_the_default_again(server: Server) -> None:
    """The server removes a default from the address and writes any other value there."""
    with closing(Session(server.address)) as session:
        session.run("Glossary")
        for method in ("weighted", "auto"):
            session.choose("Estimator", method)
            session.run("Glossary")
            assert ("estimator=weighted" in session.query) == (method == "weighted")


def test_no_message_stands_for_one_that_a_page_may_have_dropped(server: Server) -> None:
    """Asked for while another page still ran, a page kept a figure for the next run no longer.

    Its browser then gave up the connection for good, in the middle of a page.
    """
    with closing(Session(server.address)) as session:
        figures = [len([e for e in session.run("Records") if e.HasField("plotly_chart")]) for _ in "12"]
        assert figures[0] == figures[1] > 0
        assert session.references == 0


def test_descriptors_are_released_after_sessions_end(server: Server) -> None:
    with visiting(server):
        pass
    wait_for(lambda: sessions(server) == 0)
    before = settled(lambda: descriptors(server))  # without those of other tests
    for _ in range(tries(1, nightly=2)):
        visitors = [Session(server.address) for _ in range(3)]
        for visitor in visitors:
            visitor.run("")
        assert descriptors(server) >= before + 3 * len(visitors)  # one event loop each
        for visitor in visitors:
            visitor.close()
    wait_for(lambda: descriptors(server) <= before)


def sessions(server: Server) -> int:
    with urllib.request.urlopen(f"{server.address}/_stcore/metrics?families=active_sessions") as answer:
        (count,) = re.findall(r"^active_sessions (\d+)", answer.read().decode(), re.MULTILINE)
    return int(count)


def settled(value: Callable[[], int]) -> int:
    """The value once it has stayed the same for two patiences."""
    since, now = time.monotonic(), value()
    while time.monotonic() < since + 2 * PATIENCE_S:
        time.sleep(0.1)
        if (then := value()) != now:
            since, now = time.monotonic(), then
    return now


def wait_for(condition: Callable[[], bool]) -> None:
    until = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.1)
