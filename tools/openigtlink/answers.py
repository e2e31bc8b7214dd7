"""What clients may ask, and what they get: GET_… of the protocol, and PLUS's commands. Pure."""

import json
from collections.abc import Callable
from xml.sax.saxutils import quoteattr

from drivers.errors import ProtocolError
from drivers.files.markup import xml_of
from drivers.openigtlink.content import (
    NOT_FOUND,
    UNKNOWN_INSTRUCTION,
    Command,
    Status,
    Words,
    parse_command,
    parse_words,
    types_content,
)
from drivers.openigtlink.message import UTF_8, Message
from drivers.printable import printable
from tools.openigtlink.wording import (
    NAMES,
    STATUS_NAME,
    TRANSFORM_NAME,
    fields_of,
    state_message,
    status_message,
    status_of,
    transform_message,
)
from tools.shared.status_watch import Seen

TYPES = (
    "STATUS", "STRING", "TRANSFORM", "CAPABILITY", "GET_STATUS", "GET_STRING", "GET_TRANS", "GET_CAPABIL", "COMMAND",
    "RTS_COMMAND",
)  # fmt: skip
"""Message types that this server sends or answers."""

COMMANDS = ("GetStatus", "GetTransform", "RequestDeviceIds")
_ASK, _REPLY = "CMD_", "ACK_"
"""How the device name of a STRING begins that holds a command of PLUS, and that of its answer."""

_NO_PICTURES = "the service hands on neither pictures nor poses; take them where it gets them"


def answer_to(message: Message, seen: Seen, utc_ns: int) -> Message | None:
    """None for what asks nothing, such as data that a client sends. utc_ns: see wording."""
    version = min(message.version, 2)
    answers: dict[str, Callable[[], Message | None]] = {
        "GET_STATUS": lambda: status_message(seen, utc_ns, version, message.number),
        "GET_STRING": lambda: state_message(seen, utc_ns, version, message.number),
        "GET_TRANS": lambda: _transform(message, seen, utc_ns, version),
        "GET_TRANSFORM": lambda: _transform(message, seen, utc_ns, version),
        "GET_CAPABIL": lambda: Message(
            "CAPABILITY", STATUS_NAME, types_content(TYPES), version=version, number=_number(message)
        ),
        "COMMAND": lambda: _to_command(message, seen),
        "STRING": lambda: _to_words(message, seen),
    }
    return answers.get(message.kind, lambda: _refused(message, version))()


def _refused(message: Message, version: int) -> Message | None:
    if message.kind.startswith(("STT_", "STP_")):
        return Message(f"RTS_{message.kind[4:]}"[:12], message.device, b"\1", version=version, number=_number(message))
    if message.kind.startswith("GET_"):
        return _refusal(message, UNKNOWN_INSTRUCTION, f"{_shown(message.kind)} is not answered; {_NO_PICTURES}")
    return None


def _transform(message: Message, seen: Seen, utc_ns: int, version: int) -> Message:
    if message.device not in ("", TRANSFORM_NAME):
        return _refusal(message, NOT_FOUND, f"there is only {TRANSFORM_NAME}; {_NO_PICTURES}")
    found = transform_message(seen, utc_ns, version, message.number)
    return found or _refusal(message, NOT_FOUND, "no calibration is in force")


def _refusal(message: Message, code: int, words: str) -> Message:
    content = Status(code, 0, "refused", words).content
    return Message("STATUS", message.device, content, version=min(message.version, 2), number=_number(message))


def _number(message: Message) -> int:
    return message.number if message.version > 1 else 0


def _to_command(message: Message, seen: Seen) -> Message:
    """PLUS's newer way: COMMAND is answered by RTS_COMMAND with the same number and name."""
    try:
        command = parse_command(message.content)
    except ProtocolError as error:
        return _refusal(message, UNKNOWN_INSTRUCTION, error.what)
    name, granted, words = _obeyed(command.text, command.name, seen)
    reply = f"<CommandReply Name={quoteattr(name)} {_outcome(granted, words)}></CommandReply>"
    metadata = (("Status", UTF_8, _word(granted)), ("Message" if granted else "Error", UTF_8, words))
    return Message(
        "RTS_COMMAND",
        message.device,
        Command(command.number, command.name, reply).content,
        version=min(message.version, 2),
        number=_number(message),
        metadata=metadata if message.version > 1 else (),
    )


def _to_words(message: Message, seen: Seen) -> Message | None:
    """PLUS's older way: a STRING of the device CMD_n is answered by one of ACK_n; any other asks nothing."""
    if not message.device.startswith(_ASK):
        return None
    try:
        text = parse_words(message.content).text
    except ProtocolError as error:
        return _refusal(message, UNKNOWN_INSTRUCTION, error.what)
    _, granted, words = _obeyed(text, "", seen)
    reply = f"<CommandReply {_outcome(granted, words)} />"
    device = _REPLY + message.device.removeprefix(_ASK)
    version = min(message.version, 2)
    return Message("STRING", device, Words(reply).content, version=version, number=_number(message))


def _obeyed(text: str, name: str, seen: Seen) -> tuple[str, bool, str]:
    """(name of the command, whether it was granted, what is said)."""
    try:
        element = xml_of(text.encode(errors="surrogateescape")) if text else None
    except ValueError as error:
        return _shown(name), False, f"the command cannot be read: {printable(str(error))}"
    attributes = {} if element is None else element.attrib
    name = attributes.get("Name", name)
    answers: dict[str, Callable[[], tuple[bool, str]]] = {
        "GetStatus": lambda: (True, json.dumps({"status": _said(seen), **fields_of(seen)})),
        "GetTransform": lambda: _matrix(attributes.get("TransformName", TRANSFORM_NAME), seen),
        "RequestDeviceIds": lambda: (True, ",".join(NAMES)),
    }
    if name not in answers:
        return _shown(name), False, f"'{_shown(name)}' is not a command of this server; it knows {', '.join(COMMANDS)}"
    return (name, *answers[name]())


def _said(seen: Seen) -> str:
    status = status_of(seen)
    return f"{status.code} {status.error}: {status.text}"


def _matrix(name: str, seen: Seen) -> tuple[bool, str]:
    reference = None if seen.status is None else seen.status["reference"]
    if name != TRANSFORM_NAME:
        return False, f"there is only {TRANSFORM_NAME}; {_NO_PICTURES}"
    if reference is None:
        return False, "no calibration is in force"
    return True, " ".join(f"{number:.9g}" for row in reference["image_to_probe"] for number in row)


def _outcome(granted: bool, words: str) -> str:
    return f"Status={quoteattr(_word(granted))} {'Message' if granted else 'Error'}={quoteattr(words)}"


def _word(granted: bool) -> str:
    return "SUCCESS" if granted else "FAIL"


def _shown(name: str) -> str:
    return printable(name, 40)
