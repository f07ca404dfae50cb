import http.client
import signal
import socket
from urllib.parse import urlsplit

import pytest

import mems_impact as mi
from tests.explorer.subjects import zhao

OWN = """
import mems_impact as mi


def pol(mode, t, y, p):
    return y.v, p.mu * (1.0 - y.x * y.x) * y.v - y.x


system = mi.System(states=("x", "v"), flow=pol, parameters={"mu": 1.0}, initial={"x": 1.0})
"""


def answer(address, path="/", **headers):
    """Return the status that a request gets."""
    connection = http.client.HTTPConnection(urlsplit(address).netloc, timeout=60)
    connection.request(
        "GET", path, headers={name.replace("_", "-"): v for name, v in headers.items()}
    )
    return connection.getresponse().status


def test_a_port_that_is_taken_is_reported():
    from mems_impact.explorer.server import serve

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(mi.InvalidParameter, match=f"port = {port}: is in use; choose another"):
            serve(zhao(), port, print)


@pytest.mark.nightly
def test_it_answers_this_machine_alone_and_ends_with_ctrl_c(served, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    server = served("own.py:system", folder=tmp_path)
    port = urlsplit(server.address).port
    assert answer(server.address) == 200
    assert answer(server.address, Host=f"localhost:{port}") == 200
    assert answer(server.address, Host="evil.example") == 403
    assert answer(server.address, Host=f"127.0.0.1.evil.example:{port}") == 403
    own = f"http://127.0.0.1:{port}"
    assert answer(server.address, Origin=own, Referer=f"{own}/?A=1", Sec_Fetch_Site="none") == 200
    for foreign in (  # an image, a link, a frame of another site; another server of this machine
        {"Referer": "http://evil.example/"},
        {"Referer": f"{own}@evil.example/"},
        {"Origin": f"{own}1"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site", "Referer": "http://localhost:8888/"},
    ):
        assert answer(server.address, **foreign) == 403
    upgrade = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec_WebSocket_Version": "13",
        "Sec_WebSocket_Key": "dGhlIHNhbXBsZSBub25jZQ==",
        "Sec_WebSocket_Protocol": "bokeh, token",
    }
    assert answer(server.address, "/ws", Origin="http://evil.example", **upgrade) == 403
    # Only on the loopback: what comes in by another address of the machine is not heard.
    for *_, (host, *_) in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET):
        if not host.startswith("127."):
            with socket.socket() as other:
                assert other.connect_ex((host, port)) != 0
    status, said = server.end(signal.SIGINT)
    assert status == 0
    assert "Traceback" not in said
