"""A local Bokeh server."""

from __future__ import annotations

import errno
from collections.abc import Callable

from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets
from tornado.routing import HostMatches, Rule, RuleRouter

from mems_impact.errors import InvalidParameter
from mems_impact.explorer.session import Subject, slider_specs
from mems_impact.explorer.view.page import Page

__all__ = ["serve"]

LOOPBACK = "127.0.0.1"
HOST_NAMES = (LOOPBACK, "localhost")


def serve(subject: Subject, port: int, ready: Callable[[str], None]) -> None:
    """Serve the pages of a subject until Ctrl-C.

    Parameters
    ----------
    subject : Subject
    port : int
        Port of the server; 0 for any free port.
    ready : callable
        ``ready(address)`` is called when the page can be opened.

    Raises
    ------
    InvalidParameter
        If the port cannot be opened.

    Notes
    -----
    The server listens on 127.0.0.1. It rejects requests for other host names, which a foreign page
    could map to this machine, and accepts websockets only from its own pages.
    """
    specs = slider_specs(subject)
    pages: list[Page] = []

    def show(document: Document) -> None:
        arguments = document.session_context.request.arguments
        query = {
            name: [value.decode("utf-8", "replace") for value in values]
            for name, values in arguments.items()
        }
        pages.append(Page(document, subject, specs, query))

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
    local_hosts = "|".join(name.replace(".", r"\.") for name in HOST_NAMES)
    http = HTTPServer(RuleRouter([Rule(HostMatches(f"^({local_hosts})$"), application)]))
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
