"""A session without a browser: messages of the page's client to the server, and the answers."""

from __future__ import annotations

import re
import time
from contextlib import ExitStack
from typing import Any
from urllib.parse import parse_qsl, urlencode
from urllib.request import Request, urlopen

from streamlit.proto.BackMsg_pb2 import BackMsg
from streamlit.proto.ForwardMsg_pb2 import ForwardMsg
from streamlit.proto.WidgetStates_pb2 import WidgetState
from websockets.sync.client import connect

PATIENCE_S = 60.0
_ENDED = (ForwardMsg.FINISHED_SUCCESSFULLY, ForwardMsg.FINISHED_FRAGMENT_RUN_SUCCESSFULLY)


class Session:
    """One person's connection; ``run`` goes to a page and returns all that the server sent for it."""

    def __init__(self, address: str) -> None:
        url = address.replace("http://", "ws://") + "/_stcore/stream"
        self.address = address
        self._open = ExitStack()
        way = connect(url, subprotocols=["streamlit"], max_size=None, open_timeout=PATIENCE_S)  # type: ignore[list-item]
        self.socket = self._open.enter_context(way)
        self.page = self.query = ""
        self.widgets: dict[str, WidgetState] = {}
        self.begun: Any = None
        """Message of the server at the start of the last run: pages, theme."""
        self.sent: list[Any] = []
        self.heard: set[str] = set()
        """Hashes of all elements: the client may keep them all."""
        self.references = 0
        """Messages that stand for one that the client should have kept."""
        self.asked: list[Any] = []
        """Reruns of its own that the page last run has asked for: interval and fragment."""

    def run(self, page: str, query: str = "") -> list[Any]:
        """Run a page by its name in the address; returns its elements."""
        self.page, self.query = page, query or self.query
        self.sent = []
        self._rerun()
        return self.sent

    def settle(self) -> float:
        """Rerun as the page's client would; return the duration in seconds."""
        took = 0.0
        while self.asked:
            wish = self.asked.pop()
            time.sleep(wish.interval)
            begin = time.perf_counter()
            self._rerun(wish.fragment_id)
            took += time.perf_counter() - begin
        return took

    def _rerun(self, fragment: str = "") -> None:
        message = BackMsg()
        message.rerun_script.page_name = self.page
        message.rerun_script.query_string = self.query
        message.rerun_script.fragment_id = fragment
        message.rerun_script.is_auto_rerun = bool(fragment)
        message.rerun_script.cached_message_hashes.extend(self.heard)
        message.rerun_script.widget_states.widgets.extend(self.widgets.values())
        self.socket.send(message.SerializeToString())
        self.asked = []
        while True:
            got = ForwardMsg()
            got.ParseFromString(self.socket.recv(timeout=PATIENCE_S))  # type: ignore[arg-type]
            kind = got.WhichOneof("type")
            if kind == "page_info_changed":
                self.query = got.page_info_changed.query_string
            elif kind == "new_session":
                self.begun = got.new_session
            elif kind == "delta" and got.delta.WhichOneof("type") == "new_element":
                self.sent.append(got.delta.new_element)
                self.heard.add(got.hash)
            elif kind == "ref_hash":
                self.references += 1
            elif kind == "delta" and got.delta.WhichOneof("type") == "new_transient":  # a spinner
                self.sent += got.delta.new_transient.elements
            elif kind == "auto_rerun":
                self.asked.append(got.auto_rerun)
            elif kind == "script_finished":
                if got.script_finished in _ENDED:
                    return
                self.asked = []  # of a run that gave way to another one

    def shows(self, kind: str, label: str) -> Any:
        """Return the select box or slider of this label on the page last run; None without one."""
        found = (getattr(e, kind) for e in self.sent if e.HasField(kind))
        return next((element for element in found if element.label == label), None)

    def choose(self, label: str, value: str) -> None:
        """Choose in a select box of the page last run; the next run says so."""
        box = self.shows("selectbox", label)
        self.widgets[box.id] = WidgetState(id=box.id, string_value=value)
        if box.query_param_key:  # the client keeps it in the address, the default by its absence
            address = dict(parse_qsl(self.query)) | {box.query_param_key: value}
            if value == box.options[box.default]:
                del address[box.query_param_key]
            self.query = urlencode(address)

    def slide(self, label: str, value: float) -> None:
        """Move a slider of the page last run; the next run says so."""
        state = WidgetState(id=self.shows("slider", label).id)
        state.double_array_value.data.append(value)
        self.widgets[state.id] = state

    def upload(self, label: str, name: str, data: bytes) -> None:
        """Give a file to the uploader whose label begins so; the next run reads it."""
        message = BackMsg()
        session = self.begun.initialize.session_id
        message.file_urls_request.session_id = session
        message.file_urls_request.file_names.append(name)
        self.socket.send(message.SerializeToString())
        got = ForwardMsg()
        while got.WhichOneof("type") != "file_urls_response":
            got.ParseFromString(self.socket.recv(timeout=PATIENCE_S))  # type: ignore[arg-type]
        (urls,) = got.file_urls_response.file_urls
        with urlopen(f"{self.address}/_stcore/health") as answer:
            (token,) = re.findall("_streamlit_xsrf=([^;]+)", answer.headers["Set-Cookie"])
        head = f'--b\r\nContent-Disposition: form-data; name="f"; filename="{name}"\r\n\r\n'.encode()
        headers = {"Content-Type": "multipart/form-data; boundary=b", "X-Xsrftoken": token}
        headers["Cookie"] = f"_streamlit_xsrf={token}"
        body = head + data + b"\r\n--b--\r\n"
        with urlopen(Request(self.address + urls.upload_url, body, headers, method="PUT")):
            pass
        box = next(
            e.file_uploader for e in self.sent
            if e.HasField("file_uploader") and e.file_uploader.label.startswith(label)
        )  # fmt: skip
        state = WidgetState(id=box.id)
        state.file_uploader_state_value.uploaded_file_info.add(
            name=name, size=len(data), file_id=urls.file_id, file_urls=urls
        )
        self.widgets[box.id] = state

    def close(self) -> None:
        self._open.close()
