"""URLs of devices that are not there, one for each kind of thing that a URL can name."""

from probewatch.drivers.descriptor import (
    FILM,
    GPIO_CHIP,
    HOST,
    RECORDING,
    SERIAL_PORT,
    SOCKET,
    SOUND_CARD,
    VIDEO_NODE,
    Driver,
)

ABSENT = {
    SERIAL_PORT: "/dev/no-such-port",
    VIDEO_NODE: "/dev/no-such-video",
    GPIO_CHIP: "/dev/no-such-chip",
    RECORDING: "/no/such/file.mha",
    FILM: "/no/such/film.mp4",
    HOST: "127.0.0.1:1",
    SOUND_CARD: "no-such-card",
    SOCKET: "/no/such/socket",
}


def absent_url(driver: Driver) -> str:
    """With the options that the driver cannot do without."""
    return driver.url(next(ABSENT[target] for target in driver.targets if target in ABSENT))
