"""The site: built with warnings as errors, its links whole, and read by a real browser,
narrow and wide.
"""

import asyncio
import json
import subprocess
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
from doors import ROOT, Tags, chromium, python

from sepv.schemes import page_of
from sepv.verification import ALL_LAWS

SIZES = ((390, 844), (1280, 800))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site; a warning is an error."""
    out = tmp_path_factory.mktemp("site")
    options = f"-q -W --keep-going -D gallery_time=0.25 -d {out / 'doctrees'} {ROOT / 'docs'} {out / 'html'}"
    python("import sys; from sphinx.cmd.build import main; sys.exit(main(sys.argv[1:]))", *options.split())
    return out / "html"


def test_every_link_leads_somewhere_and_nothing_is_fetched(site: Path) -> None:
    found = {p: [a for _, a in Tags(p.read_text(encoding="utf-8")).tags] for p in site.rglob("*.html")}
    ids = {page: {about.get("id") for about in tags} for page, tags in found.items()}
    assert len(found) > 20
    assert {"index", "api", "laws", "profiles"} <= {page.stem for page in found}
    for page, tags in found.items():
        for target in filter(None, (about.get(key) for about in tags for key in ("href", "src"))):
            parts = urlsplit(target)
            if parts.scheme in ("http", "https", "mailto", "data"):
                continue  # of text; what a page loads is seen by the browser below
            file = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            assert file.exists(), f"{page.name} links to {target}"
            if parts.fragment and file in found:
                assert unquote(parts.fragment) in ids[file], f"{page.name} links to {target}"


def test_every_law_has_its_mathematics(site: Path) -> None:
    for law in {page_of(law) for law in ALL_LAWS}:
        assert "<math" in (site / "laws" / f"{law}.html").read_text(encoding="utf-8"), f"{law} has no formula"


class Browser:
    """Chromium, driven by its own protocol."""

    def __init__(self, socket: Any) -> None:
        self.socket, self.numbers = socket, count(1)
        self.events: list[dict[str, Any]] = []

    async def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer; events that come before it are kept."""
        number = next(self.numbers)
        await self.socket.write_message(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(await asyncio.wait_for(self.socket.read_message(), 60))
            if message.get("id") == number:
                assert "error" not in message, message
                return dict(message["result"])
            self.events.append(message)

    async def value(self, expression: str) -> Any:
        """Of a script in the page."""
        found = await self.ask("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    async def visit(self, address: str) -> None:
        """Until the page has loaded."""
        self.events.clear()
        await self.ask("Page.navigate", url=address)
        while not any(e.get("method") == "Page.loadEventFired" for e in self.events):
            self.events.append(json.loads(await asyncio.wait_for(self.socket.read_message(), 60)))

    async def resize(self, width: int, height: int) -> None:
        """The window."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        await self.ask("Emulation.setDeviceMetricsOverride", **size)

    def complaints(self) -> Iterator[str]:
        """Errors of the console, and whatever is fetched from elsewhere, since the last visit."""
        for event in self.events:
            kind, about = event.get("method"), event.get("params", {})
            if kind == "Runtime.exceptionThrown":
                yield f"console: {about['exceptionDetails']['text']}"
            elif kind == "Log.entryAdded" and about["entry"]["level"] == "error":
                yield f"console: {about['entry']['text']}"
            elif kind == "Network.requestWillBeSent":
                address = about["request"]["url"]
                if not address.startswith(("file:", "data:")):
                    yield f"fetches {address}"

    async def tab(self) -> str:
        """What has the focus after a press of Tab, and whether it can be seen that it has."""
        for kind in ("rawKeyDown", "keyUp"):
            key = {"key": "Tab", "code": "Tab", "windowsVirtualKeyCode": 9}
            await self.ask("Input.dispatchKeyEvent", type=kind, **key)
        return str(await self.value(f"{SCRIPTS}; focused()"))


SCRIPTS = (ROOT / "tests" / "site_checks.js").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The socket of a browser of its own."""
    command = [*chromium(tmp_path_factory.mktemp("profile")), "--remote-debugging-port=0", "about:blank"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        line = next(line for line in process.stderr if "DevTools listening on" in line)
        yield line.split()[-1]
        process.kill()


@asynccontextmanager
async def _browser(address: str) -> AsyncIterator[Browser]:
    """A browser's page, with what is asked of it."""
    from tornado.httpclient import AsyncHTTPClient
    from tornado.websocket import websocket_connect

    listed = await AsyncHTTPClient().fetch(f"http://{urlsplit(address).netloc}/json/list")
    page = next(p for p in json.loads(listed.body) if p["type"] == "page")
    socket = await websocket_connect(page["webSocketDebuggerUrl"], max_message_size=2**26)
    browser = Browser(socket)
    try:
        for domain in ("Page", "Runtime", "Log", "Network"):
            await browser.ask(f"{domain}.enable")
        yield browser
    finally:
        socket.close()
        while await socket.read_message() is not None:
            pass  # until the other side has closed it, too


async def _look(site: Path, address: str) -> list[str]:
    """What a reader would stumble over, on every page, narrow and wide."""
    faults = []
    async with _browser(address) as browser:
        for page in sorted(site.glob("**/*.html")):
            await browser.visit(page.as_uri())
            for width, height in SIZES:
                await browser.resize(width, height)
                where = f"{page.relative_to(site)} at {width} px"
                wide = await browser.value("document.documentElement.scrollWidth - innerWidth")
                if wide > 0:
                    faults.append(f"{where}: {wide} px wider than the window")
                faint = await browser.value(f"{SCRIPTS}; faint()")
                faults += [f"{where}: {text}" for text in faint]
            faults += [f"{page.relative_to(site)}: {text}" for text in browser.complaints()]
    return faults


async def _walk(site: Path, address: str) -> list[str]:
    """What has the focus, press after press of Tab, on the first page."""
    async with _browser(address) as browser:
        await browser.resize(*SIZES[1])
        await browser.visit((site / "index.html").as_uri())
        return [await browser.tab() for _ in range(60)]


def test_a_browser_finds_nothing_to_stumble_over(site: Path, address: str) -> None:
    assert asyncio.run(_look(site, address)) == []


def test_every_page_can_be_reached_by_the_keyboard(site: Path, address: str) -> None:
    steps = [step.split("|") for step in asyncio.run(_walk(site, address))]
    texts = " ".join(text for _, _, text in steps)
    for title in ("Verify your scheme in ten minutes", "The laws", "Continuous integration"):
        assert title in texts
    unseen = {text for tag, seen, text in steps if tag in ("A", "BUTTON", "INPUT") and seen == "false"}
    assert unseen == set()
