"""Replies to one question, in the version of its header, with its number where that has one. Pure."""

from drivers.openigtlink.content import Status
from drivers.openigtlink.message import Message


def reply(message: Message, kind: str, content: bytes) -> Message:
    """The reply to the device that was asked."""
    return Message(kind, message.device, content, version=min(message.version, 2), number=number_of(message))


def refusal(message: Message, code: int, words: str) -> Message:
    """STATUS that says why not; code: of the protocol, never OK."""
    return reply(message, "STATUS", Status(code, 0, "refused", words).content)


def number_of(message: Message) -> int:
    """Number of the question; headers of version 1 have none, so 0."""
    return message.number if message.version > 1 else 0
