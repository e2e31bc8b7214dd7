"""Builds replies to one question, in the version of its header, with its number where that has one. Pure."""

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.openigtlink.client import FOLLOW_REMEDY
from probewatch.drivers.openigtlink.content import CHECK_SUM, INVALID, Status
from probewatch.drivers.openigtlink.message import CheckSumError, Header, Message


def reply(message: Message, kind: str, content: bytes) -> Message:
    """Returns the reply to the device that was asked."""
    return Message(kind, message.device, content, version=min(message.version, 2), number=number_of(message))


def refusal(message: Message, code: int, words: str) -> Message:
    """Returns the STATUS that states why a question is refused. code: that of the protocol, never OK."""
    return reply(message, "STATUS", Status(code, 0, "refused", words).content)


def damaged(header: Header, error: ProtocolError) -> Message:
    """Returns the STATUS for a question that came damaged, so that its number is not known."""
    code = CHECK_SUM if isinstance(error, CheckSumError) else INVALID
    content = Status(code, 0, "refused", f"{error.what}. {FOLLOW_REMEDY}").content
    return Message("STATUS", header.device, content, version=min(header.version, 2))


def number_of(message: Message) -> int:
    """Returns the number of the question; headers of version 1 have none, so 0."""
    return message.number if message.version > 1 else 0
