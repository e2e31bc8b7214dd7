"""Reads the JSON body of a request and its values, and makes the answer to one that is refused."""

import asyncio
import json
from typing import Any

from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response

_BODY_S = 5.0
"""Seconds for a request to be sent whole once it has begun, as long as for its head."""
_MOST_BODY = 8192
"""Bytes of a request: names and a comment take some 500."""


async def body_of(request: Request) -> dict[str, Any]:
    """Returns the body of a request, empty where there is none.

    Raises BodyRefusedError where it is not a JSON object, too long, or not whole in time.
    """
    data = b""
    try:
        async with asyncio.timeout(_BODY_S):
            async for part in request.stream():
                data += part
                if len(data) > _MOST_BODY:
                    raise BodyRefusedError(f"the request has more than {_MOST_BODY} bytes", 413)
        body = json.loads(data or b"{}")
    except TimeoutError:
        raise BodyRefusedError(f"the request did not come whole within {_BODY_S:g} s", 408) from None
    except (ValueError, RecursionError, ClientDisconnect):
        body = None
    if not isinstance(body, dict):
        raise BodyRefusedError('the request is no JSON object, such as {"index": 2}', 400)
    return body


class BodyRefusedError(Exception):
    """Reports why a body that a client sent is refused, with the status of the answer."""

    def __init__(self, why: str, status: int) -> None:
        super().__init__(why)
        self.why, self.status = why, status


async def _body_refused(_: Request, error: Exception) -> Response:
    assert isinstance(error, BodyRefusedError)
    return refused(error.why, error.status)


BODY_HANDLERS = {BodyRefusedError: _body_refused}
"""Exception handlers for the application whose requests have bodies."""


def refused(why: str, status: int) -> JSONResponse:
    """Returns the answer to a request that is refused."""
    return JSONResponse({"ok": False, "error": why}, status)


def text(body: dict[str, Any], name: str) -> str:
    """Returns the text of that name; empty where there is none."""
    value = body.get(name, "")
    return value if isinstance(value, str) else ""


def whole(body: dict[str, Any], name: str) -> int:
    """Returns the whole number of that name; -1 where there is none."""
    value = body.get(name)
    return value if isinstance(value, int) and not isinstance(value, bool) else -1


def number(body: dict[str, Any], name: str) -> float:
    """Returns the number of that name; NaN where there is none, or one that no float can hold."""
    value = body.get(name)
    try:
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else float("nan")
    except OverflowError:
        return float("nan")
