"""The page on 127.0.0.1: it shows one robot to many pages, and obeys the one in control.

Every request needs the token of the printed address, its own host name, and no foreign origin: a page elsewhere in the
same browser can then neither read nor move a robot, not even with a name that leads to 127.0.0.1 (DNS rebinding).
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
import os
import secrets
import signal
import tempfile
import time
from collections.abc import Awaitable, Callable
from importlib import resources
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web

from crawler_model import CommandError, CrawlerError
from crawler_pictures import colors

from .robot import Robot

HOST = "127.0.0.1"
FRAMES = 30.0
"""Frames per second."""
_IDLE = 0.25
"""Time after which a frame is sent even if nothing happened [s]; its answer shows that the page still lives."""
_SILENT = 1.0
"""Time without an answer after which the page in control counts as lost [s]."""
_REPLACED = 4001
"""Code with which a page is closed that was opened again, after a gap in the network or in another window."""
_MOST_BYTES = 1 << 20
_UNSENT = 2
"""Number of frames that a page may not have answered before the next one is sent."""


class Client:
    """A page that is open."""

    def __init__(self, socket: web.WebSocketResponse, name: str) -> None:
        """Welcome a page.

        Args:
            socket: its connection.
            name: by which it is known again after it was closed.
        """
        self.socket, self.name = socket, name
        self.robot: Robot | None = None  # that its page shows
        self.known: Any = None
        self.sent = self.seen = 0
        self.heard = time.monotonic()


class Server:
    """The pages, the hand, and the loop that lets time pass."""

    def __init__(self, robot: Robot, token: str | None = None) -> None:
        """Prepare a server.

        Args:
            robot: what it shows and commands.
            token: what an address must contain; by default a random one.
        """
        self.robot, self.token = robot, token or secrets.token_urlsafe(16)
        self.clients: list[Client] = []
        self.hand = ""
        self.port = 0
        self.loop: asyncio.Task[None] | None = None
        self._wake = asyncio.Event()
        self._keeping = asyncio.Lock()

    @property
    def address(self) -> str:
        """The address of the page."""
        return f"http://{HOST}:{self.port}/?token={self.token}"

    async def start(self, port: int = 0) -> web.AppRunner:
        """Begin to listen.

        Args:
            port: the port; 0 for any free one.

        Returns:
            What runs the server; `cleanup` ends it.

        Raises:
            CrawlerError: if the port is in use.
        """
        app = web.Application(middlewares=[self._guard], client_max_size=_MOST_BYTES)
        app.add_routes([web.get("/", self._page), web.get("/live", self._live), web.get("/keep/{name}", self._keep)])
        app.on_shutdown.append(self._end)
        runner = web.AppRunner(app, access_log=None)
        await runner.setup()
        try:
            site = web.TCPSite(runner, HOST, port)
            await site.start()
        except OSError as error:
            await runner.cleanup()
            why = os.strerror(error.errno or 0).lower()
            raise CrawlerError(f"--port: {port} on {HOST}: {why}; leave it out to take a free port") from None
        self.port = runner.addresses[0][1]
        self.loop = asyncio.create_task(self._run())
        return runner

    async def _end(self, app: web.Application) -> None:
        self.robot.hold("the server ends")
        if self.loop is not None:
            self.loop.cancel()
        for client in list(self.clients):
            with contextlib.suppress(ConnectionError):
                await client.socket.close()

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Refuse other hosts, other origins and other tokens."""
        hosts = {f"{HOST}:{self.port}", f"localhost:{self.port}"}
        origin = request.headers.get("Origin")
        if request.headers.get("Host") not in hosts:
            raise web.HTTPForbidden(text=f"Host: use the address that was printed, http://{HOST}:{self.port}/\n")
        if origin is not None and origin not in {f"http://{host}" for host in hosts}:
            raise web.HTTPForbidden(text="Origin: another page may not use this robot\n")
        if not hmac.compare_digest(request.query.get("token", "").encode(), self.token.encode()):
            raise web.HTTPForbidden(text="token: it is missing or wrong; use the address that was printed\n")
        return await handler(request)

    async def _page(self, request: web.Request) -> web.Response:
        """Send the page: one file, without anything from elsewhere."""
        nonce = secrets.token_urlsafe(12)
        folder = resources.files("crawler_lab.play") / "page"
        names = ("play.html", "play.css", "pictures.js", "play.js")
        text, style, *scripts = ((folder / name).read_text(encoding="utf-8") for name in names)
        text = text.replace("NONCE", nonce).replace("/*STYLE*/", style).replace("/*SCRIPT*/", "".join(scripts))
        policy = (
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; connect-src 'self'; "
            "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        headers = {"Content-Security-Policy": policy, "Referrer-Policy": "no-referrer", "Cache-Control": "no-store"}
        return web.Response(text=text, content_type="text/html", headers=headers)

    async def _keep(self, request: web.Request) -> web.Response:
        """Send a file about the session."""
        name = request.match_info["name"]
        if name not in self.robot.keeps:
            raise web.HTTPNotFound(text=f"{name}: there is only {', '.join(self.robot.keeps) or 'nothing to keep'}\n")
        with tempfile.TemporaryDirectory() as folder:
            async with self._keeping:
                try:
                    file = await asyncio.to_thread(self.robot.keep(name, Path(folder)))
                except (CrawlerError, ModuleNotFoundError) as error:
                    raise web.HTTPConflict(text=f"{error}\n") from None
            headers = {"Content-Disposition": f'attachment; filename="{file.name}"', "Cache-Control": "no-store"}
            return web.Response(body=file.read_bytes(), content_type="application/octet-stream", headers=headers)

    async def _live(self, request: web.Request) -> web.WebSocketResponse:
        """Serve a page until it closes."""
        socket = web.WebSocketResponse(max_msg_size=_MOST_BYTES, compress=False)
        await socket.prepare(request)
        client = Client(socket, request.query.get("name", "")[:40] or secrets.token_urlsafe(8))
        for other in [other for other in self.clients if other.name == client.name]:
            await other.socket.close(code=_REPLACED, message=b"opened again")
        self.hand = self.hand or client.name
        self.clients.append(client)
        sender = asyncio.create_task(self._send(client))
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    await self._receive(client, message.data)
        finally:
            sender.cancel()
            self.clients.remove(client)
            if self._holder() is None:
                self.robot.hold("the page in control was closed")
        return socket

    def _holder(self) -> Client | None:
        """Find the page in control, if it is open."""
        return next((client for client in self.clients if client.name == self.hand), None)

    async def _receive(self, client: Client, text: str) -> None:
        """Obey a message, or answer what is wrong with it."""
        # parse
        client.heard = time.monotonic()
        try:
            message = json.loads(text)
            if not isinstance(message, dict):
                raise ValueError
        except (ValueError, RecursionError):
            await client.socket.send_json({"error": "message: it must be a JSON object"})
            return
        # a page confirms the frames that it has drawn
        if "seen" in message:
            client.seen = max(client.seen, message["seen"] if type(message["seen"]) is int else 0)
            self._notify()
            return
        # a request: anybody may take control or ask for a link, all else is for who has it
        try:
            if message.get("take"):
                self.robot.hold("another page took control")
                self.hand = client.name
            elif message.get("link"):
                await client.socket.send_json({"link": self.robot.link()})
            elif client.name != self.hand:
                raise CommandError("another page controls it; take control first")
            elif "lesson" in message:
                self.robot = await asyncio.to_thread(self.robot.open_lesson, str(message["lesson"]))
            else:
                self.robot.receive(message)
        except CommandError as error:
            await client.socket.send_json({"error": str(error)})
        self._notify()

    async def _run(self) -> None:
        """Let time pass, and hold when the page in control falls silent."""
        before = due = time.monotonic()
        while True:
            due = max(due + 1.0 / FRAMES, before)
            await asyncio.sleep(due - time.monotonic())
            now = time.monotonic()
            self.robot.advance(now - before)
            before = now
            holder = self._holder()
            if holder is not None and now - holder.heard > _SILENT:
                self.robot.hold("the page in control is silent")
            self._notify()

    def _notify(self) -> None:
        """Wake all that wait for news."""
        self._wake.set()
        self._wake = asyncio.Event()

    async def _send(self, client: Client) -> None:
        """Send frames to a page, as fast as it answers them."""
        last, place = 0.0, None
        while not client.socket.closed:
            if client.robot is not self.robot:
                client.robot, client.known, place = self.robot, None, None
                client.seen = client.sent  # the page forgets the frames of another robot
                scene = {"scene": self.robot.describe(), "colors": _colors(), "you": client.name}
                with contextlib.suppress(ConnectionError):
                    await client.socket.send_json(scene)
                continue
            now = time.monotonic()
            changed = place != self.robot.place
            if client.sent - client.seen < _UNSENT and (changed or now - last > _IDLE or client.sent == 0):
                client.sent += 1
                place, last = self.robot.place, now
                fresh, past = self.robot.past(client.known)
                client.known = place
                frame = {**self.robot.frame(), "frame": client.sent, "fresh": fresh, "past": past}
                frame |= {"hand": client.name == self.hand, "pages": len(self.clients)}
                with contextlib.suppress(ConnectionError):
                    await client.socket.send_str(json.dumps(frame))
            await self._wake.wait()


def _colors() -> dict[str, str]:
    names = ("FORWARD", "BACK", "BOTH", "STICK", "GREY", "ACTUATION", "STALLED", "WALL")
    return {name.lower(): getattr(colors, name) for name in names}


async def serve(server: Server, port: int, ready: Callable[[str], None]) -> None:
    """Serve until SIGINT or SIGTERM arrives.

    Args:
        server: the server.
        port: the port; 0 for any free one.
        ready: called with the address as soon as the server listens.
    """
    runner = await server.start(port)
    try:
        ready(server.address)
        assert server.loop is not None
        with contextlib.suppress(NotImplementedError):  # Windows has no SIGTERM to handle
            asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, server.loop.cancel)
        with contextlib.suppress(asyncio.CancelledError):
            await server.loop
    finally:
        await runner.cleanup()
