"""The door of the live page, knocked at by real HTTP and WebSocket clients: who is let in, and who may press."""

import http.client
import json
import queue
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import numpy as np
import pytest
import viser
import zstandard
from playwright.sync_api import expect
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from companion.view.control import Control
from companion.view.door import check_address
from companion.view.live import Page
from companion.view.sources import Link
from protocol.transport import Memory, TransportError
from tests.companion.view.browser import PATIENCE_MS, needs_chromium, opened

PATIENCE_S = PATIENCE_MS * 1e-3
"""Reached by a test that fails only."""
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0.0, 0.0, 5.0),
    "fov": 1.0,
    "near": 0.1,
    "far": 100.0,
    "image_height": 100,
    "image_width": 100,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


class Session:
    """A WebSocket to the page, as its own script opens it, and the elements of the page that it was told of."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self.titles: list[str] = []
        """Titles of the questions that were asked."""
        self._buttons: dict[str, tuple[str, bool | str]] = {}
        """The element of each, and its value when the button is pressed."""

    def send(self, message: Any) -> None:
        self._socket.send(msgspec.msgpack.encode(message))

    def look(self) -> None:
        """viser takes a session for connected when it knows where it looks from."""
        self.send(CAMERA)

    def press(self, label: str) -> None:
        """A button, once the page has it."""
        self.hear(lambda: label in self._buttons)
        element, value = self._buttons[label]
        self.send({"type": "GuiUpdateMessage", "uuid": element, "updates": {"value": value}})

    def hear(self, is_right: Callable[[], bool]) -> None:
        """Listen until something holds."""
        while not is_right():
            frame = self._socket.recv(PATIENCE_S, decode=False)
            packed = int.from_bytes(frame[8:16], "little")
            data = zstandard.ZstdDecompressor().decompress(frame[16 : 16 + packed])
            for message in msgspec.msgpack.decode(data)["messages"]:
                if message["type"] == "GuiButtonMessage":
                    self._buttons[message["props"]["label"]] = message["uuid"], True
                elif message["type"] == "GuiButtonGroupMessage":
                    self._buttons |= {option: (message["uuid"], option) for option in message["props"]["options"]}
                elif message["type"] == "GuiModalMessage":
                    self.titles.append(message["title"])


class Asked(Control):
    """The vehicle's control, and what it was asked for."""

    def __init__(self) -> None:
        super().__init__(lambda data: None, lambda: 0)
        self.asked: queue.Queue[str] = queue.Queue()

    def ask(self, request: str) -> None:
        self.asked.put(request)


@pytest.fixture
def page() -> Iterator[Page]:
    """A page with buttons on a vehicle that says nothing."""
    link, _ = Memory.pair()
    live = Page(Link("memory", link, b""), 0, control=Asked())
    yield live
    live.stop()


def came(page: Page, path: str, origin: str | None = "", **headers: str) -> Any:
    """A WebSocket to a path. `origin`: the page's own, if empty."""
    host = f"127.0.0.1:{page.port}"
    own = Origin(f"http://{host}" if origin == "" else origin) if origin is not None else None
    protocol = [Subprotocol(f"viser-v{viser.__version__}")]
    return connect(
        f"ws://{host}{path}", origin=own, subprotocols=protocol, additional_headers=headers, compression=None
    )


def path_of(page: Page) -> str:
    return page.url.removeprefix(f"http://127.0.0.1:{page.port}")


def get(page: Page, path: str, **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=PATIENCE_S)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    answer.read()
    connection.close()
    return answer


@pytest.mark.parametrize("origin", ["https://evil.example", "null", "http://127.0.0.1:1", "http://localhost", None])
def test_another_site_s_web_socket_is_refused_even_with_the_token(page: Page, origin: str | None) -> None:
    for path in ("/", path_of(page)):
        with pytest.raises(InvalidStatus) as refused, came(page, path, origin):
            pass
        assert refused.value.response.status_code == 403


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "evil.example:80", "[::1", "0.0.0.0", ""])
def test_another_name_for_this_machine_is_refused(page: Page, host: str) -> None:
    """A site whose name leads here has itself for Host and for Origin."""
    assert get(page, path_of(page), Host=host).status == 403
    request = f"GET {path_of(page)} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nUpgrade: websocket\r\n"
    assert answered(page, request) == 403


def answered(page: Page, request: str) -> int:
    """The status of the answer to a handshake that no client would send."""
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=PATIENCE_S)
    connection.connect()
    connection.send(
        f"{request}Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
    )
    answer = http.client.HTTPResponse(connection.sock)
    answer.begin()
    connection.close()
    return answer.status


def test_two_hosts_are_none(page: Page) -> None:
    own = f"127.0.0.1:{page.port}"
    lines = f"Host: {own}\r\nHost: evil.example\r\nOrigin: http://{own}\r\nUpgrade: websocket\r\n"
    assert answered(page, f"GET {path_of(page)} HTTP/1.1\r\n{lines}") == 403


@pytest.mark.parametrize("upgrade", ["websocket", "WebSocket"])
def test_an_upgrade_is_one_in_any_letters(page: Page, upgrade: str) -> None:
    own = f"127.0.0.1:{page.port}"
    lines = f"Host: {own}\r\nOrigin: http://{own}\r\nUpgrade: {upgrade}\r\n"
    assert answered(page, f"GET {path_of(page)} HTTP/1.1\r\n{lines}") == 101


def test_two_upgrades_are_none(page: Page) -> None:
    own = f"127.0.0.1:{page.port}"
    lines = f"Host: {own}\r\nOrigin: http://{own}\r\nUpgrade: websocket\r\nUpgrade: websocket\r\n"
    assert answered(page, f"GET {path_of(page)} HTTP/1.1\r\n{lines}") == 200


def test_what_is_no_browser_is_no_fault_of_the_page(page: Page, caplog: pytest.LogCaptureFixture) -> None:
    for request in (b"HEAD / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", b"\x16\x03\x01\x02", b"GET / HTTP/1.0\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", page.port), timeout=PATIENCE_S) as visitor:
            visitor.sendall(request)
            visitor.shutdown(socket.SHUT_WR)
            while visitor.recv(1024):
                pass
    assert not caplog.records
    assert get(page, path_of(page)).status == 200


def test_a_wrong_token_opens_nothing(page: Page) -> None:
    token = path_of(page).strip("/")
    for wrong in ("x", token[:-1], token + "x", token.swapcase(), "%00", "index.html", "../pyproject.toml"):
        assert get(page, f"/{wrong}/").status == 404
        with pytest.raises(InvalidStatus) as refused, came(page, f"/{wrong}"):
            pass
        assert refused.value.response.status_code == 404
    own = f"Host: 127.0.0.1:{page.port}\r\n"
    assert answered(page, f"GET /{'é' * len(token)} HTTP/1.1\r\n{own}") == 404


def test_every_answer_forbids_frames_and_foreign_scripts(page: Page) -> None:
    for path, status in ((path_of(page), 200), ("/", 200), ("/x", 404)):
        answer = get(page, path)
        assert answer.status == status
        assert answer.headers["X-Frame-Options"] == "DENY"
        assert answer.headers["Referrer-Policy"] == "no-referrer"
        policy = dict(part.strip().split(" ", 1) for part in answer.headers["Content-Security-Policy"].split(";"))
        assert policy["default-src"] == policy["frame-ancestors"] == policy["base-uri"] == "'none'"
        assert "unsafe-inline" not in policy["script-src"] and "'unsafe-eval'" not in policy["script-src"]
        assert "http" not in policy["connect-src"] and "*" not in answer.headers["Content-Security-Policy"]
    assert get(page, "/x", Host="evil.example").headers["X-Frame-Options"] == "DENY"


def test_who_has_the_token_presses_and_who_has_not_looks_on(page: Page) -> None:
    """An onlooker is told all that there is; what it sends is not heard, whatever it is."""
    with came(page, "/") as looks, came(page, path_of(page).rstrip("/")) as operates:
        onlooker, operator = Session(looks), Session(operates)
        operator.look()
        onlooker.press("land")
        onlooker.send({"type": "ShareUrlRequest"})
        looks.send(b"\xc1")
        looks.send("text")
        looks.send(msgspec.msgpack.encode([1, 2]))
        onlooker.send({"type": ["GuiUpdateMessage"]})
        arrived = threading.Event()
        page._server.on_client_connect(lambda client: arrived.set())
        onlooker.look()
        assert arrived.wait(PATIENCE_S), "what was sent after all of this was heard"
        operator.press("hold")
        onlooker.hear(lambda: bool(onlooker.titles))
        assert onlooker.titles == ["Ask the vehicle to hold?"]
        onlooker.press("yes, hold")
        operator.press("land")
        operator.press("yes, land")
        operator.hear(lambda: len(operator.titles) == 2)
        assert isinstance(page._control, Asked) and page._control.asked.get(timeout=PATIENCE_S) == "land"
        assert page._control.asked.empty()
        assert page.cameras.watched


def test_a_dialog_is_sent_when_its_buttons_work(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is pressed before it has its function does nothing, and a busy server takes its time for that."""
    buffer = page._server._websock_server.get_message_buffer()
    is_held: list[bool] = []
    given = viser.GuiButtonHandle.on_click

    def on_click(button: Any, function: Any) -> Any:
        is_held.append(buffer.atomic_counter > 0)
        return given(button, function)

    monkeypatch.setattr(viser.GuiButtonHandle, "on_click", on_click)
    with came(page, path_of(page)) as operates:
        operator = Session(operates)
        operator.look()
        operator.press("land")
        operator.press("yes, land")
        assert isinstance(page._control, Asked) and page._control.asked.get(timeout=PATIENCE_S) == "land"
    assert is_held == [True, True]


def test_nobody_shares_the_page_with_the_internet(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    """viser's own page offers it; here not even the operator can."""
    asked: list[object] = []
    monkeypatch.setattr(page._server, "request_share_url", lambda *_: asked.append(1))
    with came(page, path_of(page)) as operates:
        operator = Session(operates)
        operator.look()
        operator.send({"type": "ShareUrlRequest"})
        operator.press("land")
        operator.hear(lambda: bool(operator.titles))
    assert asked == []


def test_two_pages_have_two_tokens(page: Page) -> None:
    link, _ = Memory.pair()
    other = Page(Link("memory", link, b""), 0)
    assert path_of(page) != path_of(other)
    assert len(path_of(page).strip("/")) >= 43, "256 bits"
    other.stop()


@pytest.mark.parametrize(
    ("address", "remote", "says"),
    [
        ("192.0.2.1", False, "--allow-remote"),
        ("192.0.2.1", True, "192.0.2.1"),
        ("0.0.0.0", True, "name one address"),
        ("example.org", True, "not an IPv4 address"),
    ],
)
def test_the_page_is_not_opened_to_others_by_accident(address: str, remote: bool, says: str) -> None:
    with pytest.raises(TransportError, match=says):
        check_address(address, remote=remote)


def test_loopback_needs_no_permission() -> None:
    for address in ("127.0.0.1", "127.0.0.2"):
        check_address(address, remote=False)


HOSTILE = (
    "</td></p><img src=x onerror='document.hit=1'><script>document.hit=2</script>{document.hit=3}[a](javascript:1)"
)


@needs_chromium
def test_texts_from_outside_are_text() -> None:
    """Names of a world's obstacles, of a flight and of its troubles, and answers, where they are shown."""
    world = f"[[box]]\nname = {json.dumps(HOSTILE)}\ncenter = [5.0, 0.0]\nsize = [2.0, 2.0]\nheight = 5.0\n"
    link, _ = Memory.pair()
    control = Asked()
    control.answer = HOSTILE
    page = Page(Link(HOSTILE, link, world.encode()), 0, control=control)
    page._problem = HOSTILE
    assert page._panel is not None
    with opened(page.url) as (browser, errors):
        page.step(0.1)
        page._panel._here = lambda: np.array([0.0, 0.0, -2.0])
        page._panel._ask_height(np.array([10.0, 0.0, 0.0]), np.array([0.0, 0.0, -2.0]))
        page.step(0.1)
        expect(browser.get_by_text("In the way")).to_contain_text(HOSTILE)
        expect(browser.locator("#flight")).to_have_text(HOSTILE)
        expect(browser.get_by_text(HOSTILE)).to_have_count(5)
        assert browser.evaluate("document.hit") is None
        assert browser.locator("a[href^=javascript]").count() == 0
        assert errors == []
    page.stop()
