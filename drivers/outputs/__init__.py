"""Holds the alarm outputs, one per file, and what several of them need. Energised means safe.

DRIVERS describes each of them and can be read without importing the drivers (drivers/descriptor.py).
"""

from probewatch.drivers.descriptor import GPIO_CHIP, SERIAL_PORT, SOUND_CARD, Contact, Driver, Option, Twin
from probewatch.drivers.outputs.heartbeat import CLICKS, HEARTBEAT

_WATCHDOG = "hardware watchdog, or `heartbeat=`"
_PITCHES_HZ = (150, 1000)
"""Bounds of the fundamental of an alarm, Hz, by IEC 60601-1-8."""
_CHANNELS = (1, 16)
"""Channels of LCUS boards: the largest on sale have 16 relays."""

_LEVEL = Option("active", "the level that energises", "high", words=("high", "low"), refusal="is not known")

RELAY = Driver(
    "relay",
    "probewatch.drivers.outputs.relay",
    "LCUS-type relay boards",
    "serial, 9600 baud",
    {"output": "relay:/dev/ttyUSB1"},
    (SERIAL_PORT,),
    (
        Option("channel", "the relay of the board", "1", bounds=_CHANNELS, refusal="is not a relay of such a board"),
        Option(
            "confirm",
            "auto: a board that has reported its contacts must go on; yes: every board must; no: none is asked",
            "auto",
            words=("auto", "yes", "no"),
            refusal="is not known",
        ),
        CLICKS,
    ),
    Twin("relay", "an LCUS relay board on a pseudo-terminal"),
    is_listed=True,
    contact=Contact(
        "boards that answer, `confirm=yes` insists", "the board holds until the unit's next command", _WATCHDOG
    ),
)
GPIO = Driver(
    "gpio",
    "probewatch.drivers.outputs.gpio",
    "relays on a GPIO line",
    "kernel's GPIO chips",
    {"output": "gpio:/dev/gpiochip0?line=17"},
    (GPIO_CHIP,),
    (
        Option("line", "the line that drives the relay, see `gpioinfo`", form="NUMBER|NAME", required=True),
        _LEVEL,
        HEARTBEAT,
        Option("sense", "an input that is active while the contact is closed", form="NUMBER|NAME"),
        Option("sense_active", "its level then", _LEVEL.default, words=_LEVEL.words, refusal=_LEVEL.refusal),
    ),
    is_listed=True,
    contact=Contact(
        "the line; the contact with `sense=LINE`",
        "the chip's driver releases the line, or holds it until the unit's next command",
        _WATCHDOG,
    ),
)
SERIALPIN = Driver(
    "serialpin",
    "probewatch.drivers.outputs.serialpin",
    "relays on a control line of a serial port",
    "serial",
    {"output": "serialpin:/dev/ttyUSB1?pin=rts"},
    (SERIAL_PORT,),
    (
        HEARTBEAT,
        Option(
            "pin",
            "the line that drives the relay",
            words=("rts", "dtr"),
            required=True,
            refusal="is not a line that can be driven",
        ),
        Option(
            "sense",
            "an input that is raised while the contact is closed",
            words=("cts", "dsr", "dcd"),
            refusal="is not a line that can be read",
        ),
    ),
    contact=Contact("the contact with `sense=cts`, `dsr` or `dcd`", "the kernel drops the line at once", _WATCHDOG),
)
TONE = Driver(
    "tone",
    "probewatch.drivers.outputs.tone",
    "sound cards",
    "ALSA, through `aplay`",
    {"output": "tone:default"},
    (SOUND_CARD,),
    (Option("pitch", "of the alarm's fundamental", "440", "Hz", _PITCHES_HZ, refusal="is not the pitch of an alarm"),),
    contact=Contact("no", "the sound ends with it", "hardware watchdog", serves_contact=False),
)
DRIVERS = (RELAY, GPIO, SERIALPIN, TONE)
