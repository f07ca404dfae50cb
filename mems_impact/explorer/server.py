"""A local Bokeh server."""

from __future__ import annotations

import errno
from collections import deque
from collections.abc import Callable
from typing import Any

from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPServerRequest
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets
from tornado.routing import AnyMatches, Matcher, Rule, RuleRouter
from tornado.web import Application as WebApplication
from tornado.web import RequestHandler

from mems_impact.errors import InvalidParameter
from mems_impact.explorer.session import Subject, slider_specs
from mems_impact.explorer.snapshot import DiagramSnapshot
from mems_impact.explorer.view.page import Page

HTTP_PORT = 80
KEPT_DIAGRAMS = 8
LOOPBACK = "127.0.0.1"
HOST_NAMES = (LOOPBACK, "localhost")


class OwnRequests(Matcher):
    """Requests of the user and of the server's own pages, not of other sites.

    A page of another site may send a request to this machine, and may map its host name to it.
    Browsers say where a request comes from.
    """

    def __init__(self, port: int) -> None:
        number = "" if port == HTTP_PORT else f":{port}"  # browsers omit that of HTTP
        self.origins = tuple(f"http://{name}{number}/" for name in HOST_NAMES)

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """Return no arguments for the handler; None for a request of another site."""
        headers = request.headers
        origins = [f"http://{headers.get('Host')}/"]
        origins += [f"{headers[name]}/" for name in ("Origin", "Referer") if name in headers]
        own = headers.get("Sec-Fetch-Site", "none") in ("none", "same-origin")
        return {} if own and all(each.startswith(self.origins) for each in origins) else None


class Refusal(RequestHandler):
    """Answer to a request of another site."""

    def prepare(self) -> None:
        """Refuse every method."""
        self.set_status(403)
        self.finish("This request comes from another page. Enter the address in the browser.")


def serve(subject: Subject, port: int, ready: Callable[[str], None]) -> None:
    """Serve the pages of a subject on 127.0.0.1 until Ctrl-C.

    The server answers the user and its own pages only, so that another site can start no
    computation: see `OwnRequests`. Port 0 is any free port; ``ready(address)`` is called when the
    page can be opened. Raises InvalidParameter if the port cannot be opened.
    """
    specs = slider_specs(subject)
    pages: list[Page] = []
    complete: deque[DiagramSnapshot] = deque(maxlen=KEPT_DIAGRAMS)

    def show(document: Document) -> None:
        arguments = document.session_context.request.arguments
        query = {
            name: [value.decode("utf-8", "replace") for value in values]
            for name, values in arguments.items()
        }
        pages.append(Page(document, subject, specs, query, complete))

    try:
        sockets = bind_sockets(port, LOOPBACK)
    except (OSError, OverflowError) as error:
        in_use = getattr(error, "errno", None) == errno.EADDRINUSE
        problem = "is in use" if in_use else f"cannot be opened ({error})"
        problem += "; choose another port, or 0 for any free port"
        raise InvalidParameter("port", port, "", problem=problem) from None
    number = sockets[0].getsockname()[1]
    loop = IOLoop.current()
    application = BokehTornado(
        {"/": Application(FunctionHandler(show))},
        extra_websocket_origins=[f"{name}:{number}" for name in HOST_NAMES],
    )
    others = Rule(AnyMatches(), WebApplication([(".*", Refusal)]))
    http = HTTPServer(RuleRouter([Rule(OwnRequests(number), application), others]))
    http.add_sockets(sockets)
    server = BaseServer(loop, application, http)
    server.start()
    ready(f"http://{LOOPBACK}:{number}/")
    try:
        loop.start()
    except KeyboardInterrupt:
        pass
    finally:
        for page in pages:
            page.stop()
        server.stop(wait=False)
        http.stop()
