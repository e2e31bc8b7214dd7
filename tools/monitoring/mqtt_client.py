"""Provides a client of an MQTT broker that publishes and expects nothing but short answers, so that a broker can take
neither memory nor processor: one that sends more is left.
"""

import math
import struct
import time

from paho.mqtt import MQTTException
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MessageType, MQTTErrorCode, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

_LONGEST_ANSWER = 1000
"""Bytes of a packet after its length, which are announced to the broker. Mosquitto's are under 30; what is longer was
not asked for, and the library keeps it until it is whole: up to 256 MB, which is all memory of the unit."""
_MOST_HEARD_S = 1000
"""Bytes of answers in a second: 250 acknowledgements. A connection has some ten at its beginning and one a second then;
more lets a broker that acknowledges without end take the processor."""
_AROUND = 16
"""Bytes of a message by MQTT 5 beside its topic and content: 14 with a time to expire. More calls a message too large
that is not; less has the broker break off."""
_REASONS = (0x00, 0x10, 0x80, 0x83, 0x87, 0x90, 0x91, 0x97, 0x99)
"""Reasons of an acknowledgement by MQTT 5 (3.4.2.1) that the library knows; it takes an answer with another for no
MQTT."""
_UNSPECIFIED, _QUOTA_EXCEEDED, _TOO_LARGE = 0x80, 0x97, 0x95
"""Reasons of an acknowledgement. Mosquitto sends the last for a message beyond its `message_size_limit`; it becomes the
second."""
_ANSWERS = (MessageType.CONNACK, MessageType.PUBACK, MessageType.PINGRESP, MessageType.DISCONNECT)


class TellingClient(Client):
    """Extends the library's client so that it leaves a broker that sends more than answers. trouble: what the broker
    did wrong; empty where nothing. malformed: whether that was an answer which is not one of this version of MQTT.
    largest: bytes of a packet that the broker takes, as it states when it accepts; it leaves a client that sends a
    larger one.
    """

    def __init__(self, name: str, version: MQTTProtocolVersion) -> None:
        super().__init__(CallbackAPIVersion.VERSION2, client_id=name, protocol=version, reconnect_on_failure=False)
        self.trouble = ""
        self.malformed = False
        self.largest = math.inf
        self.refuses = version is MQTTProtocolVersion.MQTTv5
        self._heard_s, self._heard = 0.0, 0

    def open(self, host: str, port: int, keepalive_s: int) -> None:
        """Connects, which does not yet mean to be accepted. Raises OSError and ValueError."""
        properties = None
        if self.refuses:
            properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
            properties.MaximumPacketSize = _LONGEST_ANSWER
            properties.RequestProblemInformation = 0
        self.connect(host, port, keepalive_s, properties=properties)

    def takes(self, topic: str, payload: str) -> bool:
        """Returns whether the message is small enough for the broker."""
        return len(topic.encode()) + len(payload.encode()) + _AROUND <= self.largest

    def _sock_recv(self, bufsize: int) -> bytes:
        """Receives bytes. The library asks here for as much as a packet has announced, before it has any of it. Raises
        OSError.
        """
        if bufsize > _LONGEST_ANSWER:
            self._complain(bufsize)
            raise ConnectionAbortedError(self.trouble)
        received = super()._sock_recv(bufsize)
        now_s = time.monotonic()
        if now_s - self._heard_s > 1.0:
            self._heard_s, self._heard = now_s, 0
        self._heard += len(received)
        if self._heard > _MOST_HEARD_S:
            self.trouble = "it sends answers without end"
            raise ConnectionAbortedError(self.trouble)
        return received

    def _packet_handle(self) -> MQTTErrorCode:
        """Handles a packet that is whole, for which the library calls it; an exception would end its thread unseen."""
        command, packet = self._in_packet["command"] & 0xF0, self._in_packet["packet"]
        if command not in _ANSWERS:
            self._complain(len(packet))
            return MQTTErrorCode.MQTT_ERR_PROTOCOL
        if command == MessageType.PUBACK and len(packet) > 2 and packet[2] not in _REASONS:
            packet[2] = _QUOTA_EXCEEDED if packet[2] == _TOO_LARGE else _UNSPECIFIED
        try:
            return super()._packet_handle()
        except (MQTTException, ValueError, LookupError, TypeError, struct.error):
            self.trouble, self.malformed = "it answers in another protocol", True
            return MQTTErrorCode.MQTT_ERR_PROTOCOL

    def _complain(self, bytes_: int) -> None:
        self.trouble = f"it sends {bytes_} unsolicited bytes"
