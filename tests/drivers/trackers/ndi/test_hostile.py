"""A tracker that lies with right check sums: every reply of a whole session may say anything."""

import random
from collections import Counter

import pytest

from probewatch.drivers.errors import ConfigurationError, DeviceLost, ProtocolError
from probewatch.drivers.trackers.ndi.wire import CR, EXTENDED_START, PLAIN_START, encode_container, encode_text
from probewatch.drivers.twins.ndi.models import AURORA, SPECTRA, VEGA, Model
from tests.support.simulated_ndi import Bench, bench
from tests.support.stopwatch import Stopwatch

SAYINGS = (
    "",
    "OKAY",
    "ERROR01",
    "ERROR99",
    "RESET",
    "0" * 8000,
    "FFFFFFFF",
    "-1",
    "9" * 6000,
    "nan",
    " ",
    "\n",
    "=",
    "00",
)


def lied(reply: bytes, chance: random.Random) -> bytes:
    """The reply with something else in it, framed and summed as it must be."""
    if reply.startswith(PLAIN_START):
        return encode_container(shuffled(reply[6:-2], chance)[:65535])
    if reply.startswith(EXTENDED_START):
        return encode_container(shuffled(reply[6:], chance), extended=True)
    if not reply.endswith(CR) or len(reply) < 5:
        return reply
    if chance.random() < 0.3:
        return encode_text(chance.choice(SAYINGS))
    text = shuffled(reply[:-5], chance)
    return encode_text("".join(chr(byte) if 32 <= byte < 127 or byte == 10 else "?" for byte in text)[:8000])


def shuffled(data: bytes, chance: random.Random) -> bytes:
    """Bytes changed, doubled, cut."""
    changed = bytearray(data)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(changed) + 1)
        match chance.randrange(4):
            case 0:
                changed[at:at] = changed[: chance.randrange(64)]
            case 1:
                del changed[at : at + chance.randrange(16)]
            case 2:
                changed[at : at + 4] = chance.choice((b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f", b"FFFF"))
            case _:
                changed[at : at + 1] = bytes([chance.randrange(256)])
    return bytes(changed)


def attack(model: Model, seed: int, tmp_path_factory: pytest.TempPathFactory) -> str:
    """One session; how it ended."""
    chance = random.Random(seed)
    share = chance.choice((0.02, 0.1, 0.5))
    with bench(tmp_path_factory.mktemp("lies"), model=model, wired=("probe",) if model is AURORA else ()) as cart:
        true = cart.line.write

        def write(data: bytes, baud: int, start_ns: int) -> None:
            true(lied(data, chance) if chance.random() < share else data, baud, start_ns)

        cart.line.write = write  # type: ignore[method-assign]
        watch = Stopwatch()
        ending = conversation(cart)
        assert ending is None or str(ending).isprintable()
        assert watch.spent_s() < 30
    return "read" if ending is None else type(ending).__name__


def conversation(cart: Bench) -> Exception | None:
    """Connect and read; the refusal that ended it, if one did."""
    try:
        with cart.open(deadline_ms="400") as tracker:
            for _ in range(10):
                told = tracker.describe()
                texts = (told.model, told.firmware, told.serial_number, *told.tools, *told.remarks)
                assert all(text.isprintable() and len(text) < 1000 for text in texts)
                tracker.read(0.1)
    except (ConfigurationError, DeviceLost, ProtocolError) as error:
        return error
    return None


@pytest.mark.parametrize("model", [SPECTRA, VEGA, AURORA], ids=["spectra", "vega", "aurora"])
def test_lies_end_in_a_named_loss_or_a_pose(model: Model, tmp_path_factory: pytest.TempPathFactory) -> None:
    ends = Counter(attack(model, seed, tmp_path_factory) for seed in range(4))
    assert sum(ends.values()) == 4


@pytest.mark.slow
@pytest.mark.parametrize("model", [SPECTRA, VEGA, AURORA], ids=["spectra", "vega", "aurora"])
def test_lies_at_length(model: Model, tmp_path_factory: pytest.TempPathFactory) -> None:
    ends = Counter(attack(model, seed, tmp_path_factory) for seed in range(100, 300))
    print(model, ends)
    assert ends["read"] > 5
    assert ends["DeviceLost"] + ends["ProtocolError"] > 20
