"""The app's server: streamlit behind connections that end when a client stalls.

Uvicorn ends idle connections and websockets without pongs, but neither a request whose bytes trickle in
nor a client that takes no response. Streamlit keeps a session after its tab has closed, with an event
loop and three descriptors, until another tab closes.
"""

import asyncio
import gc
import inspect
import os
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib import import_module
from time import monotonic
from typing import Any

import streamlit as st
import uvicorn
from starlette.exceptions import HTTPException
from streamlit import config, runtime
from uvicorn.protocols.http.h11_impl import H11Protocol

from jointid.ui.shared.messages import show_error
from jointid.ui.shared.results import last_seen

PATIENCE_S = float(os.environ.get("JOINTID_PATIENCE_S", 20.0))
LEAST_BYTES = 20_000
"""Least traffic of a client in ``PATIENCE_S``: more than the longest head of a request."""
MOST_OF_SESSION, MOST_OF_ALL = 1 << 30, 2 << 30
"""Bytes of the uploads that a session, and all together, can have in memory."""
_MOST_CONNECTIONS = 500
"""Fifty tabs with seven connections each; with their sessions below the usual 1024 descriptors."""
PRELOADED = (
    "pandas",
    "streamlit.emojis",
    "jointid.figures.response",
    "jointid.cut.outcome",
    "jointid.uncertainty.validation",
)
"""Imported before the address is open, so that the first page need not: half of its time."""
_FIRST_SCREEN = ("jointid.ui.cut.panels", "jointid.ui.study.elasticity_figures")
"""They register components with the running server, hence cannot be imported before."""
KEPT_S = 3 * PATIENCE_S
"""Time for a tab to connect again, for instance after its network failed, s."""


class PatientConnection(H11Protocol):
    """An HTTP connection that ends when its client stalls."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to watch a connection; end it where too many are open."""
        super().connection_made(transport)
        if len(self.connections) > _MOST_CONNECTIONS:
            transport.close()
        self._begin_period()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop watching."""
        self._timer.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Count the bytes that the client sends."""
        self._received += len(data)
        super().data_received(data)

    def resume_writing(self) -> None:
        """Note that the client has taken most of what waited for it."""
        self._takes = True
        super().resume_writing()

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Leave the connection to the pings of the websocket."""
        self._timer.cancel()
        super().handle_websocket_upgrade(event)

    def _begin_period(self) -> None:
        self._request, self._received, self._takes = self.cycle, 0, False
        self._timer = self.loop.call_later(PATIENCE_S, self._judge)

    def _judge(self) -> None:
        request = self.cycle
        awaited = request is None or request.response_complete or request.more_body
        begun = request is not self._request or self._received >= LEAST_BYTES
        sends = not awaited or begun or self.flow.read_paused
        if sends and (self._takes or not self.flow.write_paused):
            self._begin_period()
        else:
            self.transport.abort()


def bound_uploads(manager: Any) -> None:
    """Refuse uploads beyond the limits of a session and of all; streamlit limits single files only."""
    add = manager.add_file

    def add_file(session_id: str, file: Any) -> None:
        sizes = {
            session: sum(len(kept.data) for kept in [*files.values()])
            for session, files in [*manager.file_storage.items()]
        }
        own = sizes.get(session_id, 0) + len(file.data)
        if own > MOST_OF_SESSION or sum(sizes.values()) + len(file.data) > MOST_OF_ALL:
            raise HTTPException(413, "The uploads of this session, or of all sessions, are too large.")
        add(session_id, file)

    manager.add_file = add_file


@asynccontextmanager
async def _lifespan(_app: object) -> AsyncIterator[dict[str, Any]]:
    bound_uploads(runtime.get_instance().uploaded_file_mgr)
    closing = asyncio.create_task(_close_sessions())
    preparing = asyncio.create_task(asyncio.to_thread(prepare))
    yield {}
    closing.cancel()
    preparing.cancel()


def prepare() -> None:
    """Get the first screen ready while the first browser still loads its own code."""
    for name in _FIRST_SCREEN:
        import_module(name)
    inspect.stack()  # streamlit asks for it on the first page: 0.09 s until all modules are known
    import_module("jointid.ui.shared.page").analyse_first_sample()
    gc.freeze()  # else each full collection stops all sessions for 0.1 s


async def _close_sessions() -> None:
    """Close sessions whose tab has closed; streamlit's own limit counts further departures only."""
    server = runtime.get_instance()
    while True:
        await asyncio.sleep(PATIENCE_S)
        now = monotonic()
        for session, last in list(last_seen.items()):
            if server.is_active_session(session):
                last_seen[session] = now
            elif now - last > KEPT_S:
                del last_seen[session]
                server.close_session(session)


def show_internal_error(error: Exception) -> bool:
    """Show one message in place of streamlit's box; the server's log has the traceback."""
    show_error(
        f"Internal error, {type(error).__name__} ({error!s:.300}). This is a bug in jointid, not in "
        "your data; studies and entries are kept. Choose another page or study in the sidebar."
    )
    return True


def serve(script: str, port: int) -> None:
    """Serve the app until a signal ends it; ``.streamlit/config.toml`` beside it holds the address."""
    for name in PRELOADED:
        import_module(name)
    app = st.App(script, lifespan=_lifespan, on_script_error=show_internal_error)
    config.set_option("server.port", port)
    address = config.get_option("server.address") or "127.0.0.1"
    # Streamlit lowers the level of uvicorn's loggers.
    sys.stderr.write(f"The app is at http://{address}:{port}; Ctrl-C stops it.\n")
    uvicorn.run(
        app,
        host=address,
        port=port,
        http=PatientConnection,
        ws="websockets-sansio",  # streamlit's choice
        ws_ping_interval=PATIENCE_S,
        ws_ping_timeout=PATIENCE_S,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=3,
        access_log=False,
    )
