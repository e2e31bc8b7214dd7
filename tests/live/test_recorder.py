"""The recorder beside a whole cart: its files say again what the service said, and its death is not felt."""

import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from appliance.storage.black_box import BlackBox, Series, series_of
from drivers.errors import DeviceLost
from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.polling import until
from tools.recorder.run import ask
from tools.shared.rerun import Rerun


@contextmanager
def recording(cart: Cart, text: str) -> Iterator[subprocess.Popen[bytes]]:
    """`probewatch record`, with the cart's configuration and room for little."""
    folder = cart.config.parent / "recorder"
    config = cart.config.with_name("recorder.toml")
    own = f'[recorder]\nfolder = "{folder}"\nsocket = "{folder}.socket"\ntext = "{text}"\nleave_free_gb = 0.1\n'
    config.write_text(f"{cart.config_text}\n{own}")
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


def recorded(cart: Cart) -> list[Series]:
    paths = (cart.config.parent / "recorder").rglob("*.mcap")
    return series_of(BlackBox(path) for path in paths)


def rerun(series: Series) -> Rerun:
    run = Rerun(series)
    for _ in run.steps():
        pass
    return run


def test_what_was_recorded_of_the_demos_cart_says_the_same_bit_for_bit(tmp_path: Path) -> None:
    """From the first picture of a line on: the service is killed while the recorder waits for the next one."""
    with Cart(tmp_path) as cart:
        with recording(cart, "keep") as process:
            until(lambda: told(cart).get("recording"), 30)
            pid = cart.estimator_pid()
            until(lambda: cart.status()["counters"]["frames"] > 30, 30)
            subprocess.run(["kill", "-9", str(pid)], check=True)
            cart.wait_for("monitoring", 60)
            time.sleep(5)
            assert process.poll() is None
        (series,) = recorded(cart)
        run = rerun(series)
        comparison = run.comparison
        print(comparison.sentence, [(order.generation) for order in run.orders])
        assert comparison.recorded > 300
        gaps = [one for one in comparison.gaps if "service" not in one]
        assert not gaps, gaps
        assert comparison.exact, comparison.sentence
