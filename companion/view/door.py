"""Who may open the live page, and who may press its buttons.

viser asks nobody who they are, so this stands between it and its server, which is that of `websockets`, by that
server's own hooks: what is asked for is judged before viser hears of it, and so is each message that comes in.

- Host must be the page's own address, and Origin too for a WebSocket: another web site is refused, also one whose name
  was made to lead here (DNS rebinding).
- The address that is printed has a random token in its path. Without it one looks on: the messages of such a session
  are dropped, but for those of its camera.
- Every answer forbids frames, and scripts, styles and connections of elsewhere (Content-Security-Policy).
"""

import base64
import contextlib
import hashlib
import io
import ipaddress
import logging
import re
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from protocol.transport import TransportError, open_url

if TYPE_CHECKING:
    import viser

_log = logging.getLogger(__name__)
_log.addFilter(lambda record: record.msg != "opening handshake failed")  # what is no browser: no fault of ours
LOOPBACK = "127.0.0.1"
_LOOPBACK_NAMES = {LOOPBACK, "localhost"}
_ONLOOKER_SENDS = frozenset({"ViewerCameraMessage"})
_OPERATOR_SENDS = _ONLOOKER_SENDS | {"GuiUpdateMessage", "ScenePointerMessage"}
"""What the page's elements need. viser knows more: ShareUrlRequest opens the page to the internet."""
_LARGEST_MESSAGE = 1 << 16
"""Size of a browser's message (bytes) at most. A camera's is 0.3 kB."""
_ONLOOKER_SIGN = (
    b'<div id="onlooker" style="position:fixed;bottom:0;left:0;z-index:1000;padding:2px 8px;background:#fffc;'
    b'font:13px sans-serif">You look on: the address that was printed has the controls.</div>'
)


def check_address(address: str, *, remote: bool) -> None:
    """Raise TransportError unless the page may be served at an address: beyond loopback only if `remote`."""
    try:
        parsed = ipaddress.IPv4Address(address)
    except ValueError:
        raise TransportError(f"{address}: not an IPv4 address") from None
    if parsed.is_unspecified:
        raise TransportError(f"{address}: name one address of this machine")
    if not (remote or parsed.is_loopback):
        raise TransportError(f"{address} is not loopback: other machines could open the page (--allow-remote)")
    open_url(f"udpin:{address}:0").close()  # viser would look for a port without an end


class Door:
    """The door of the page at an IPv4 `address`."""

    def __init__(self, address: str) -> None:
        import viser

        self.address = address
        self.token = secrets.token_urlsafe(32)
        self._names = {address} | (_LOOPBACK_NAMES if ipaddress.IPv4Address(address).is_loopback else set())
        page = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()
        self._page = page.replace(b"<title>Viser</title>", b"<title>Courier</title>")
        self._policy = _policy(self._page)
        self._is_used = False

    def open(self, port: int, label: str) -> "viser.ViserServer":
        """A server of viser's behind this door. Raises RuntimeError if viser goes around it."""
        import viser

        serve = websockets.asyncio.server.serve

        def guarded(handler: Any, host: str, port: int, **options: Any) -> Any:
            self._is_used = True
            options |= {"process_request": self._judge, "process_response": self._close_in}
            options |= {"create_connection": Visitor, "max_size": _LARGEST_MESSAGE, "server_header": None}
            options |= {"logger": _log}
            return serve(handler, host, port, **options)

        with _replaced(websockets.asyncio.server, "serve", guarded), contextlib.redirect_stdout(io.StringIO()):
            server = viser.ViserServer(host=self.address, port=port, label=label, verbose=False)
        if not self._is_used:
            server.stop()
            raise RuntimeError("this version of viser does not use the server that guards the page")
        return server

    def _judge(self, visitor: ServerConnection, request: Request) -> Response | None:
        """The answer to a request; None lets a WebSocket in."""
        headers, path = request.headers, request.path.partition("?")[0].strip("/")
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        if len(hosts) != 1 or re.sub(r":\d*$", "", hosts[0]) not in self._names:
            return visitor.respond(403, "This page is not at that address.\n")
        is_operator = secrets.compare_digest(path.encode(errors="surrogateescape"), self.token.encode())
        if path and not is_operator:
            return visitor.respond(404, "There is nothing here: the token of another run?\n")
        if [each.lower() for each in headers.get_all("Upgrade")] != ["websocket"]:
            page = self._page if is_operator else self._page.replace(b"<body>", b"<body>" + _ONLOOKER_SIGN, 1)
            fields = {"Content-Type": "text/html; charset=utf-8", "Content-Length": str(len(page))}
            return Response(200, "OK", Headers(fields), page)
        if origins != [f"http://{hosts[0]}"]:
            return visitor.respond(403, "Another site's pages can't connect to this one.\n")
        assert isinstance(visitor, Visitor)
        visitor.may_send = _OPERATOR_SENDS if is_operator else _ONLOOKER_SENDS
        return None

    def _close_in(self, visitor: ServerConnection, request: Request, response: Response) -> None:
        """Keep every answer out of frames, and apart from other sites."""
        socket = f"ws://{request.headers.get_all('Host')[0]}" if response.status_code == 200 else ""
        response.headers["Content-Security-Policy"] = self._policy.format(socket=socket)
        response.headers["X-Frame-Options"] = "DENY"
        response.headers["X-Content-Type-Options"] = "nosniff"
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers["Cross-Origin-Opener-Policy"] = "same-origin"
        response.headers["Cross-Origin-Resource-Policy"] = "same-origin"
        response.headers["Cache-Control"] = "no-store"


class Visitor(ServerConnection):
    """A session of a browser, of whose messages viser receives those that it may send."""

    may_send: frozenset[str] = frozenset()

    async def recv(self, decode: bool | None = None) -> Any:
        """The next message that may be sent. One that can't be read is dropped, too."""
        while True:
            message = await super().recv(decode)
            if _type(message) in self.may_send:
                return message


def _type(message: str | bytes) -> str | None:
    """The name of a message of viser's; None if it is none."""
    try:
        name = msgspec.msgpack.decode(message).get("type") if isinstance(message, bytes) else None
    except (msgspec.DecodeError, AttributeError):
        return None
    return name if isinstance(name, str) else None


def _policy(page: bytes) -> str:
    """The Content-Security-Policy of viser's page, with {socket} for its WebSocket.

    Its one script, known by its hash, unpacks a second one and is trusted with it. Nothing may evaluate strings; that
    costs viser's Gaussian splats, of which the page has none.
    """
    scripts = re.findall(rb"<script[^>]*>(.*?)</script>", page, re.DOTALL)
    hashes = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'" for script in scripts)
    return (
        f"default-src 'none'; script-src {hashes} 'strict-dynamic' 'wasm-unsafe-eval'; worker-src blob: data:; "
        "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; connect-src data: blob: {socket}; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


@contextlib.contextmanager
def _replaced(module: Any, name: str, value: Any) -> Iterator[None]:
    """A module with another value under a name."""
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)
