"""The server under clients that stall, and after its visitors have left; attacked without a browser."""

from __future__ import annotations

import base64
import os
import re
import socket
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import pytest
from browsing import Server
from sessions import Session

PATIENCE_S = 1.0
pytestmark = pytest.mark.skipif(
    not Path("/proc/self/fd").exists(), reason="descriptors are read in /proc"
)


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


def ended_after(connection: socket.socket, trickle: Callable[[int], bytes]) -> float:
    """Seconds until the server ends a connection that sends a few bytes ten times per second."""
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
    return time.monotonic() - begin


def test_a_connection_without_request_ends(server: Server) -> None:
    with connected(server) as connection:
        assert ended_after(connection, lambda _: b"") < 3 * PATIENCE_S


def test_a_request_that_trickles_in_ends(server: Server) -> None:
    with connected(server) as connection:
        connection.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n")
        assert ended_after(connection, lambda step: b"X-%d: 1\r\n" % step) < 3 * PATIENCE_S


def test_a_second_request_that_trickles_in_ends(server: Server) -> None:
    with connected(server) as connection:
        connection.sendall(b"GET /_stcore/health HTTP/1.1\r\nHost: x\r\n\r\nGET / HTTP/1.1\r\n")
        assert ended_after(connection, lambda step: b"X-%d: 1\r\n" % step) < 4 * PATIENCE_S


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


@pytest.mark.parametrize("trickle", [b"", b"1,2,3\n"], ids=["stopped", "slow"])
def test_an_upload_that_stalls_ends(server: Server, trickle: bytes) -> None:
    with visiting(server) as session, connected(server) as connection:
        connection.sendall(upload(server, session) + b"time,q\n" * 9000)
        took = ended_after(connection, lambda _: trickle)
    assert PATIENCE_S < took < 4 * PATIENCE_S


def test_an_upload_at_a_slow_network_is_kept(server: Server) -> None:
    with visiting(server) as session, connected(server) as connection:
        connection.sendall(upload(server, session))
        for _ in range(15):
            connection.sendall(b"time,q\n" * 3000)
            time.sleep(0.2)
        connection.settimeout(0.1)
        with pytest.raises(TimeoutError):
            connection.recv(1)


def test_a_client_that_takes_no_response_ends(server: Server) -> None:
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
    assert 0 < received < every / 2


def test_a_websocket_without_pongs_ends(server: Server) -> None:
    key = base64.b64encode(os.urandom(16)).decode()
    with connected(server) as connection:
        connection.sendall(
            "GET /_stcore/stream HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        took = ended_after(connection, lambda _: b"")
    assert PATIENCE_S < took < 5 * PATIENCE_S


def test_it_follows_no_files(server: Server) -> None:
    with visiting(server):
        links = [os.readlink(link) for link in Path(f"/proc/{server.process.pid}/fd").iterdir()]
    assert links
    assert "anon_inode:inotify" not in links


def test_descriptors_come_back_after_visitors_leave(server: Server) -> None:
    with visiting(server):
        pass
    wait_for(lambda: sessions(server) == 0)
    time.sleep(5 * PATIENCE_S)  # and those of other tests
    before = descriptors(server)
    for _ in range(2):
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


def wait_for(condition: Callable[[], bool]) -> None:
    until = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.1)
