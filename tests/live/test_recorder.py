"""The recorder beside a whole cart: its files say again what the service said, and its death is not felt."""

import json
import resource
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.storage.black_box import BlackBox
from probewatch.appliance.storage.black_box_fields import Gap, Mark, State
from probewatch.drivers.errors import DeviceLost, RecordingError
from probewatch.drivers.samples import Pose
from probewatch.tools.recorder.run import ask
from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.polling import until


@contextmanager
def recording(cart: Cart, text: str) -> Iterator[subprocess.Popen[bytes]]:
    """`probewatch record`, with the cart's configuration and room for little."""
    folder = cart.config.parent / "recorder"
    config = cart.config.with_name("recorder.toml")
    own = f'[recorder]\nfolder = "{folder}"\nsocket = "{folder}.socket"\ntext = "{text}"\nleave_free_gb = 0.1\n'
    config.write_text(f"{cart.config_text}\n{own}")
    # A recorder that is there before the feed notes a gap.
    until((cart.config.parent / "feed").exists, 30)
    process = subprocess.Popen([PROBEWATCH, "record", "--config", config], stderr=subprocess.PIPE)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=20)


def told(cart: Cart) -> dict[str, object]:
    """How the recorder does; nothing while it does not answer."""
    try:
        return ask(cart.config.parent / "recorder.socket", "status")
    except DeviceLost:
        return {}


def states(cart: Cart, where: str = "") -> set[str]:
    """Those that the recorder has written so far; a file whose first part is still to come has none."""
    found = set[str]()
    for path in (cart.config.parent / "recorder" / where).rglob("*.mcap"):
        with suppress(RecordingError):
            found |= {str(told.item.status["state"]) for told in BlackBox(path).items() if isinstance(told.item, State)}
    return found


def replayed(cart: Cart) -> dict[str, object]:
    """What `probewatch replay` says of everything that was recorded."""
    folder = cart.config.parent / "recorder"
    done = subprocess.run([PROBEWATCH, "replay", folder, "--json"], check=True, capture_output=True)
    said: dict[str, object] = json.loads(done.stdout)["black_box"]
    return said


@pytest.mark.alone
def test_what_was_recorded_of_the_demos_cart_says_the_same_bit_for_bit(tmp_path: Path) -> None:
    """From the first picture of a line on: the service is killed while the recorder waits for the next one."""
    with Cart(tmp_path) as cart:
        with recording(cart, "keep") as process:
            until(lambda: told(cart).get("recording"), 30)
            pid = cart.estimator_pid()
            until(lambda: cart.status()["counters"]["frames"] > 30, 30)
            subprocess.run(["kill", "-9", str(pid)], check=True)
            until(lambda: cart.status()["counters"]["estimator_restarts"] > 0, 30)
            seen = cart.status()["counters"]["frames"]
            until(lambda: cart.status()["counters"]["frames"] > seen + 300, 60)
            assert process.poll() is None
        said = replayed(cart)
        assert said["recorded_verdicts"] > 150
        assert said["bit_for_bit"], said
        assert said["equal_verdicts"] == said["recorded_verdicts"]
        assert said["damage"] is None
        assert [gap for gap in said["gaps"] if "the service ended it" not in gap] == []


def test_a_recorder_that_hangs_or_dies_is_not_felt_and_leaves_what_can_be_read(tmp_path: Path) -> None:
    with Cart(tmp_path, trusting=True) as cart:
        cart.wait_for("monitoring")
        until(cart.contact)
        began_s = time.monotonic()
        with recording(cart, "blacken") as process:
            until(lambda: told(cart).get("recording"), 30)
            time.sleep(4)
            process.send_signal(signal.SIGSTOP)
            time.sleep(4)
            process.kill()
            process.wait()
        status = cart.status()
        assert (status["state"], status["energised"]) == ("monitoring", True)
        assert cart.switched(began_s) == []
        (path,) = (cart.config.parent / "recorder").rglob("*.mcap")
        box = BlackBox(path)
        items = [one.item for one in box.items()]
        assert "ends at byte" in box.damage_text
        assert sum(isinstance(item, Pose) for item in items) > 60


def test_an_alarm_of_the_cart_is_kept_with_what_was_asked_for(tmp_path: Path) -> None:
    with Cart(tmp_path, trusting=True) as cart:
        cart.wait_for("monitoring")
        with recording(cart, "keep"):
            until(lambda: told(cart).get("recording") and "monitoring" in states(cart), 30)
            cart.say("polarity")
            cart.wait_for("halt")
            ask(cart.config.parent / "recorder.socket", "start", "by hand")
            with pytest.raises(ControlRefused, match="already"):
                ask(cart.config.parent / "recorder.socket", "start")
            ask(cart.config.parent / "recorder.socket", "stop")
            time.sleep(1)
        kept = [*(cart.config.parent / "recorder" / "kept").glob("*.mcap")]
        marks = [told.item for path in kept for told in BlackBox(path).items() if isinstance(told.item, Mark)]
        assert {mark.kind for mark in marks} == {"alarm", "start", "stop"}
        assert {"monitoring", "halt"} <= states(cart, "kept")


def test_a_disk_that_takes_nothing_is_told_and_moves_no_contact(tmp_path: Path) -> None:
    """A file size limit of zero: every write of the recorder fails, as on a full disk; then it is lifted."""
    with Cart(tmp_path, trusting=True) as cart:
        cart.wait_for("monitoring")
        until(cart.contact)
        began_s = time.monotonic()
        with recording(cart, "keep") as process:
            until(lambda: told(cart).get("recording"), 30)
            before = resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
            until(lambda: told(cart).get("failing"), 30)
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, before)
            until(lambda: told(cart).get("recording"), 30)
            time.sleep(2)
        assert cart.status()["energised"]
        assert cart.switched(began_s) == []
        paths = [*(cart.config.parent / "recorder").rglob("*.mcap")]
        items = [one.item for path in paths for one in BlackBox(path).items()]
        assert [item for item in items if isinstance(item, Gap) and "the disk failed" in item.reason]
