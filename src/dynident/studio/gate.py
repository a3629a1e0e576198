"""Who may ask the studio: the browser that has the token, on this machine, from the studio's own page."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field

#: What every answer carries. Scripts and styles come from the studio itself and from nowhere else.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)

#: What a report carries that is shown inside the studio: an origin of its own, so that nothing in it can ask anything.
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; font-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)

_SAME = ("same-origin", "none")


@dataclass(frozen=True)
class Gate:
    """The checks that every request passes before anything else is done with it.

    A page of another site can send requests to any port of this machine, and a name of its own can be made to point
    here: Host, Origin and the browser's own word on where a request comes from are checked on all of them.

    Attributes:
        port: Port of the server.
        token: Secret of this run; in the address that is opened first, then in a cookie.
    """

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)

    @property
    def address(self) -> str:
        """The address to open, with the token."""
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    @property
    def hosts(self) -> tuple[str, ...]:
        """What the header Host may say."""
        return f"127.0.0.1:{self.port}", f"localhost:{self.port}"

    @property
    def cookie(self) -> str:
        """The header Set-Cookie; cookies are shared by all ports of a machine, so the port is in its name."""
        return f"{self._name}={self.token}; Path=/; HttpOnly; SameSite=Strict"

    @property
    def _name(self) -> str:
        return f"dynident-studio-{self.port}"

    def refusal(self, method: str, path: str, query: Mapping[str, str], headers: Mapping[str, str]) -> str:
        """Return why a request is refused, or an empty string.

        Args:
            method: Such as ``GET``.
            path: Path without the query.
            query: The query.
            headers: The headers by name in small letters.
        """
        if headers.get("host", "") not in self.hosts:
            return "the host of the request is not this machine"
        origin = headers.get("origin")
        if origin is None and method != "GET":
            return "the request does not say where it comes from"
        if origin is not None and origin not in {f"http://{host}" for host in self.hosts}:
            return "the request comes from another page"
        entrance = method == "GET" and path == "/"
        if not entrance and headers.get("sec-fetch-site", "none") not in _SAME:
            return "the request comes from another page"
        if entrance and self._is_token(query.get("token", "")):
            return ""
        return "" if self._is_token(self._sent(headers)) else "open the address that 'dynident studio' has printed"

    def _is_token(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(), self.token.encode())

    def _sent(self, headers: Mapping[str, str]) -> str:
        for part in headers.get("cookie", "").split(";"):
            name, _, value = part.strip().partition("=")
            if name == self._name:
                return value
        return ""
