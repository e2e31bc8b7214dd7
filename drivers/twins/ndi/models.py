"""Defines what distinguishes the simulated trackers: names, counters, rates and commands."""

from dataclasses import dataclass

_LINE_SPEEDS = {"0": 9600, "1": 14400, "2": 19200, "3": 38400, "4": 57600, "5": 115200}
"""Combined API, COMM: digit → bits per second."""


@dataclass(frozen=True, slots=True)
class Model:
    """Describes one kind of tracker.

    counter_hz: rate of the frame counter. counter_phase: remainder of every frame number modulo the step of the
    counter. track_hz: measurements a second that it can make, the usual rate first. bauds: digit of COMM → bits per
    second. fit_mm: error field of a tool when all is well. network: whether it speaks TCP, without a line speed.
    """

    name: str
    freeze_tag: str
    title: str
    serial_number: str
    firmware: str
    revision: str
    api: str
    track_hz: tuple[int, ...]
    counter_hz: int = 60
    counter_phase: int = 0
    bauds: tuple[tuple[str, int], ...] = tuple(_LINE_SPEEDS.items())
    fit_mm: float = 0.2
    bx2: bool = False
    electromagnetic: bool = False
    network: bool = False

    @property
    def version(self) -> str:
        """Returns the answer to VER 0 and VER 4."""
        return (
            f"{self.title} Control Firmware\nNDI S/N: {self.serial_number}\nCharacterization Date: 06/05/24\n"
            f"Freeze Tag: {self.freeze_tag}\nFreeze Date: 01/04/10\n(C) Northern Digital Inc.\n"
        )


VICRA = Model(
    name="polaris-vicra",
    freeze_tag="Polaris Vicra Rev 007.000",
    title="Polaris Vicra",
    serial_number="P6-00000",
    firmware="007.000.012",
    revision="014",
    api="G.001.006",
    track_hz=(20,),
    bauds=(*_LINE_SPEEDS.items(), ("7", 1228739)),
)
SPECTRA = Model(
    name="polaris-spectra",
    freeze_tag="Polaris Spectra Rev 008.000",
    title="Polaris Spectra",
    serial_number="P7-00000",
    firmware="008.000.004",
    revision="024",
    api="G.001.007",
    track_hz=(60, 30, 20),
    bauds=(*_LINE_SPEEDS.items(), ("6", 921600)),
)
VEGA = Model(
    name="vega",
    freeze_tag="Polaris Vega 014",
    title="Polaris Vega",
    serial_number="P9-00000",
    firmware="014.000.001",
    revision="024",
    api="G.003.008",
    track_hz=(60, 100, 200, 250, 400),
    bauds=(*_LINE_SPEEDS.items(), ("6", 921600)),
    bx2=True,
    network=True,
)
AURORA = Model(
    name="aurora",
    freeze_tag="AURORA Rev 008",
    title="Aurora",
    serial_number="D4-00000",
    firmware="008.000.001",
    revision="010",
    api="D.001.007",
    track_hz=(40,),
    counter_hz=320,
    counter_phase=6,
    bauds=(*_LINE_SPEEDS.items(), ("6", 921600)),
    fit_mm=0.1,
    electromagnetic=True,
)
"""Names, versions and rates as public clients and recordings have them of such devices; serial numbers are made up. A
Vega counts its own frames, an Aurora V3 counts in steps of eight with remainder 6."""

MODELS = {model.name: model for model in (VICRA, SPECTRA, VEGA, AURORA)}
