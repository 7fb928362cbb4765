"""A session without a browser: what the page's client says to the server, and what comes back."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

from streamlit.proto.BackMsg_pb2 import BackMsg
from streamlit.proto.ForwardMsg_pb2 import ForwardMsg
from streamlit.proto.WidgetStates_pb2 import WidgetState
from websockets.sync.client import connect

PATIENCE_S = 60.0


class Session:
    """One person's connection; ``run`` goes to a page and returns all that the server sent for it."""

    def __init__(self, address: str) -> None:
        url = address.replace("http://", "ws://") + "/_stcore/stream"
        self._open = ExitStack()
        way = connect(url, subprotocols=["streamlit"], max_size=None)  # type: ignore[list-item]
        self.socket = self._open.enter_context(way)
        self.query = ""
        self.widgets: dict[str, WidgetState] = {}
        self.sent: list[Any] = []

    def run(self, page: str, query: str = "") -> list[Any]:
        """Run a page by its name in the address; returns its elements."""
        message = BackMsg()
        message.rerun_script.page_name = page
        message.rerun_script.query_string = query or self.query
        message.rerun_script.widget_states.widgets.extend(self.widgets.values())
        self.socket.send(message.SerializeToString())
        self.sent = []
        while True:
            got = ForwardMsg()
            got.ParseFromString(self.socket.recv(timeout=PATIENCE_S))  # type: ignore[arg-type]
            kind = got.WhichOneof("type")
            if kind == "page_info_changed":
                self.query = got.page_info_changed.query_string
            elif kind == "delta" and got.delta.WhichOneof("type") == "new_element":
                self.sent.append(got.delta.new_element)
            elif kind == "script_finished" and got.script_finished == 0:
                return self.sent

    def choose(self, label: str, value: str) -> None:
        """Choose in a select box of the page last run; the next run says so."""
        box = next(
            e.selectbox for e in self.sent if e.HasField("selectbox") and e.selectbox.label == label
        )
        self.widgets[box.id] = WidgetState(id=box.id, string_value=value)

    def close(self) -> None:
        self._open.close()
