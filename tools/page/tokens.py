"""Decides who may do more than view: a one-time token becomes a cookie, which lasts until the page ends or the shift is
over.

The times are seconds of CLOCK_MONOTONIC, given by the caller.
"""

import hmac
import secrets
from dataclasses import dataclass

_SIGNS = "23456789ABCDEFGHJKLMNPQRSTUVWXYZ"
"""Thirty-two characters that nobody mistakes for one another when typing what another screen shows."""
_LENGTH = 8
"""Characters of a token: 40 bits. With `_MOST_WRONG_OF_ALL` tries in `_WRONG_S` it takes 1000 years to find one by
trying; more is harder to type."""
TOKEN_S = 600.0
"""Seconds for which a token waits to be used: the way from the terminal to the tablet. Longer lets somebody use it who
has seen it over the user's shoulder."""
_COOKIE_S = 12 * 3600.0
"""Seconds that a cookie lasts: a shift. Longer leaves a forgotten tablet able to recalibrate; shorter ends a scan."""
_MOST_TOKENS, _MOST_COOKIES = 8, 16
"""Tokens that wait, and cookies that are in use; one more forgets the oldest."""
_MOST_WRONG, _MOST_WRONG_OF_ALL, _WRONG_S = 10, 100, 60.0
"""Wrong tries of one address, and of all together, in the time of the third, s; beyond that none of that address, or
none at all, is considered until the time is over. Fewer locks out a user who mistypes, or lets few addresses lock all
others out; more helps whoever guesses."""


@dataclass(frozen=True, slots=True)
class Visitor:
    """Represents the holder of a cookie. name: that of the user who asked for the token, as the kernel gives it."""

    name: str
    until_s: float


class Tokens:
    """Keeps one-time tokens that nobody has used, and the cookies in use. Not safe for two threads at once."""

    def __init__(self) -> None:
        self._tokens: dict[str, Visitor] = {}
        self._cookies: dict[str, Visitor] = {}
        self._wrong: list[tuple[float, str]] = []

    def issue(self, name: str, now_s: float) -> str:
        """Returns a new token for that user, such as 7KQM-3XWD."""
        token = "".join(secrets.choice(_SIGNS) for _ in range(_LENGTH))
        self._tokens[token] = Visitor(name, now_s + TOKEN_S)
        _forget_oldest(self._tokens, _MOST_TOKENS)
        return f"{token[:4]}-{token[4:]}"

    def redeem(self, said: str, now_s: float, address: str = "") -> str | None:
        """Returns the cookie for a token, which is used up; None for a token that is wrong or too old, or where too
        many of the address were wrong.
        """
        if self.locked(now_s, address):
            return None
        typed = "".join(sign for sign in said[:64].upper() if sign.isalnum())
        found = [token for token in self._tokens if hmac.compare_digest(token.encode(), typed.encode())]
        visitor = self._tokens.pop(found[0]) if found else None
        if visitor is None or visitor.until_s < now_s:
            self._wrong.append((now_s, address))
            return None
        cookie = secrets.token_urlsafe(32)
        self._cookies[cookie] = Visitor(visitor.name, now_s + _COOKIE_S)
        _forget_oldest(self._cookies, _MOST_COOKIES)
        return cookie

    def locked(self, now_s: float, address: str = "") -> bool:
        """Returns whether too many tokens of that address, or of all, were wrong of late: none is considered then."""
        self._wrong = [wrong for wrong in self._wrong if now_s - wrong[0] < _WRONG_S]
        of_address = sum(wrong[1] == address for wrong in self._wrong)
        return of_address >= _MOST_WRONG or len(self._wrong) >= _MOST_WRONG_OF_ALL

    def visitor(self, cookie: str | None, now_s: float) -> Visitor | None:
        """Returns whose cookie that is, None where it is nobody's."""
        visitor = None if cookie is None else self._cookies.get(cookie)
        return visitor if visitor is not None and visitor.until_s >= now_s else None


def _forget_oldest(known: dict[str, Visitor], most: int) -> None:
    while len(known) > most:
        del known[next(iter(known))]
