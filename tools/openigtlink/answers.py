"""Answers what clients may ask: GET_… of the protocol, and PLUS's commands. Pure."""

import json
from collections.abc import Callable
from xml.sax.saxutils import quoteattr

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.files.markup import xml_of
from probewatch.drivers.openigtlink.content import (
    NOT_FOUND,
    UNKNOWN_INSTRUCTION,
    Command,
    Words,
    parse_command,
    parse_words,
    types_content,
)
from probewatch.drivers.openigtlink.message import UTF_8, Message
from probewatch.drivers.printable import printable
from probewatch.tools.openigtlink.asked import Names
from probewatch.tools.openigtlink.replies import number_of, refusal
from probewatch.tools.openigtlink.wording import (
    ESTIMATE_NAME,
    NAMES,
    STATUS_NAME,
    TRANSFORM_NAME,
    estimate_message,
    fields_of,
    state_message,
    status_message,
    status_of,
    transform_message,
)
from probewatch.tools.shared.status_watch import Seen

TYPES = (
    "STATUS", "STRING", "TRANSFORM", "IMAGE", "CAPABILITY", "GET_STATUS", "GET_STRING", "GET_TRANS", "GET_IMAGE",
    "GET_CAPABIL", "STT_TRANS", "STP_TRANS", "RTS_TRANS", "STT_IMAGE", "STP_IMAGE", "RTS_IMAGE", "COMMAND",
    "RTS_COMMAND",
)  # fmt: skip
"""Message types that this server sends or answers."""

COMMANDS = ("GetStatus", "GetTransform", "RequestDeviceIds")
_ASK, _REPLY = "CMD_", "ACK_"
"""Prefixes of the device name of a STRING that holds a command of PLUS, and of that of its answer."""

_CALIBRATIONS = {TRANSFORM_NAME: "no calibration is in force", ESTIMATE_NAME: "motion shows no calibration"}
"""Transforms that are made from the status → why there may be none."""


def answer_to(message: Message, seen: Seen, utc_ns: int, names: Names) -> Message | None:
    """Returns the answer; None for a message that asks nothing, such as data that a client sends. names: those of
    pictures and poses, for which a client asks through `Asked`. utc_ns: see wording.
    """
    version = min(message.version, 2)
    answers: dict[str, Callable[[], Message | None]] = {
        "GET_STATUS": lambda: status_message(seen, utc_ns, version, message.number),
        "GET_STRING": lambda: state_message(seen, utc_ns, version, message.number),
        "GET_TRANS": lambda: _transform(message, seen, utc_ns, version, names),
        "GET_TRANSFORM": lambda: _transform(message, seen, utc_ns, version, names),
        "GET_CAPABIL": lambda: Message(
            "CAPABILITY", STATUS_NAME, types_content(TYPES), version=version, number=number_of(message)
        ),
        "COMMAND": lambda: _to_command(message, seen, names),
        "STRING": lambda: _to_words(message, seen, names),
    }
    return answers.get(message.kind, lambda: _refused(message, version))()


def _refused(message: Message, version: int) -> Message | None:
    if message.kind.startswith(("STT_", "STP_")):
        return Message(
            f"RTS_{message.kind[4:]}"[:12], message.device, b"\1", version=version, number=number_of(message)
        )
    if message.kind.startswith("GET_"):
        return refusal(message, UNKNOWN_INSTRUCTION, f"{_shown(message.kind)} is not answered")
    return None


def _transform(message: Message, seen: Seen, utc_ns: int, version: int, names: Names) -> Message:
    name = message.device or TRANSFORM_NAME
    if name not in _CALIBRATIONS:
        return refusal(message, NOT_FOUND, _only(names))
    made = transform_message if name == TRANSFORM_NAME else estimate_message
    return made(seen, utc_ns, version, message.number) or refusal(message, NOT_FOUND, _CALIBRATIONS[name])


def _only(names: Names) -> str:
    return f"there are only {', '.join(_CALIBRATIONS)} and {names.pose}"


def _to_command(message: Message, seen: Seen, names: Names) -> Message:
    """Answers PLUS's newer kind of command: COMMAND is answered by RTS_COMMAND with the same number and name."""
    try:
        command = parse_command(message.content)
    except ProtocolError as error:
        return refusal(message, UNKNOWN_INSTRUCTION, error.what)
    name, granted, words = _obeyed(command.text, command.name, seen, names)
    reply = f"<CommandReply Name={quoteattr(name)} {_outcome(granted, words)}></CommandReply>"
    metadata = (("Status", UTF_8, _word(granted)), ("Message" if granted else "Error", UTF_8, words))
    return Message(
        "RTS_COMMAND",
        message.device,
        Command(command.number, command.name, reply).content,
        version=min(message.version, 2),
        number=number_of(message),
        metadata=metadata if message.version > 1 else (),
    )


def _to_words(message: Message, seen: Seen, names: Names) -> Message | None:
    """Answers PLUS's older kind of command: a STRING of device CMD_n is answered by one of ACK_n, any other is not."""
    if not message.device.startswith(_ASK):
        return None
    try:
        text = parse_words(message.content).text
    except ProtocolError as error:
        return refusal(message, UNKNOWN_INSTRUCTION, error.what)
    _, granted, words = _obeyed(text, "", seen, names)
    reply = f"<CommandReply {_outcome(granted, words)} />"
    device = _REPLY + message.device.removeprefix(_ASK)
    version = min(message.version, 2)
    return Message("STRING", device, Words(reply).content, version=version, number=number_of(message))


def _obeyed(text: str, name: str, seen: Seen, names: Names) -> tuple[str, bool, str]:
    """Returns (name of the command, whether it was granted, the text of the reply)."""
    try:
        element = xml_of(text.encode(errors="surrogateescape")) if text else None
    except ValueError as error:
        return _shown(name), False, f"the command cannot be read: {printable(str(error))}"
    attributes = {} if element is None else element.attrib
    name = attributes.get("Name", name)
    answers: dict[str, Callable[[], tuple[bool, str]]] = {
        "GetStatus": lambda: (True, json.dumps({"status": _said(seen), **fields_of(seen)})),
        "GetTransform": lambda: _matrix(attributes.get("TransformName", TRANSFORM_NAME), seen, names),
        "RequestDeviceIds": lambda: (True, ",".join((*NAMES, *names))),
    }
    if name not in answers:
        return _shown(name), False, f"'{_shown(name)}' is not a command of this server; it knows {', '.join(COMMANDS)}"
    return (name, *answers[name]())


def _said(seen: Seen) -> str:
    status = status_of(seen)
    return f"{status.code} {status.error}: {status.text}"


def _matrix(name: str, seen: Seen, names: Names) -> tuple[bool, str]:
    if name == names.pose:
        return False, f"ask for {name} by GET_TRANS or STT_TRANS: it is never the same"
    if name not in _CALIBRATIONS:
        return False, _only(names)
    rows = _rows(name, seen)
    if rows is None:
        return False, _CALIBRATIONS[name]
    return True, " ".join(f"{number:.9g}" for row in rows for number in row)


def _rows(name: str, seen: Seen) -> list[list[float]] | None:
    if seen.status is None:
        return None
    made = seen.status["reference"] if name == TRANSFORM_NAME else fields_of(seen)["estimate"]
    return None if made is None else made["image_to_probe"]


def _outcome(granted: bool, words: str) -> str:
    return f"Status={quoteattr(_word(granted))} {'Message' if granted else 'Error'}={quoteattr(words)}"


def _word(granted: bool) -> str:
    return "SUCCESS" if granted else "FAIL"


def _shown(name: str) -> str:
    return printable(name, 40)
