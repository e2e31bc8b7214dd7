"""The package's V4L2 driver on the kernel's vivid: `video.py exact FORMAT SECONDS`, `video.py faults`; prints JSON."""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from output_node import OutputNode

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.registry import open_video

NODE = "v4l2:/dev/video0?input=1&size=640x480"
DRIVER = Path("/sys/bus/platform/drivers/vivid")
CLOCK = HostClock()
COUNTED_PX = 4


def pictures() -> list[np.ndarray]:
    return list(np.random.default_rng(1).integers(0, 256, (8, 480, 640), np.uint8))


def numbered(number: int, pattern: np.ndarray) -> np.ndarray:
    """The pattern with its number in the first pixels."""
    image = pattern.copy()
    image[0, :COUNTED_PX] = np.frombuffer(np.uint32(number).tobytes(), np.uint8)
    return image


def feed(format_: str, rate_hz: float, stop: threading.Event) -> None:
    node, patterns, number = OutputNode("/dev/video1"), pictures(), 0
    while not stop.wait(1 / rate_hz):
        image = numbered(number, patterns[number % len(patterns)])
        if format_ == "YUYV":
            wide = np.full((480, 1280), 128, np.uint8)
            wide[:, ::2] = image
            image = wide
        node.write(image.tobytes())
        number += 1


def exact(format_: str, seconds: float) -> dict[str, object]:
    """How many pictures were captured, how many of them are what was written, to the last bit."""
    for node, kind in (("/dev/video0", "--set-fmt-video"), ("/dev/video1", "--set-fmt-video-out")):
        subprocess.run(["v4l2-ctl", "-d", node, f"{kind}=width=640,height=480,pixelformat={format_}"], check=True)
    stop = threading.Event()
    threading.Thread(target=feed, args=(format_, 10.0, stop), daemon=True).start()
    time.sleep(1.0)
    patterns, matched, frames, delays_ms, numbers = pictures(), 0, [], [], set()
    with open_video(f"{NODE}&format={format_}", CLOCK) as source:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            frame = source.read(0.5)
            if frame is None:
                continue
            delays_ms.append((time.monotonic_ns() - frame.stamp.t_ns) / 1e6)
            number = int(np.frombuffer(frame.image[0, :COUNTED_PX].tobytes(), np.uint32)[0])
            matched += bool(np.array_equal(frame.image, numbered(number, patterns[number % len(patterns)])))
            numbers.add(number)
            frames.append((frame.sequence, frame.stamp))
    stop.set()
    steps = np.diff([sequence for sequence, _ in frames])
    elapsed_ns = frames[-1][1].t_ns - frames[0][1].t_ns
    return {
        "frames": len(frames),
        "exact": matched,
        "different": len(numbers),
        "lost": int(steps.sum() - len(steps)),
        "backward": int((steps < 1).sum()),
        "period_ms": float(elapsed_ns / steps.sum() / 1e6),
        "err_ms": frames[-1][1].err_ns / 1e6,
        "delay_ms": float(np.median(delays_ms)),
    }


def control(**values: int) -> None:
    settings = ",".join(f"{name}={value}" for name, value in values.items())
    subprocess.run(["v4l2-ctl", "-d", "/dev/video0", "-c", settings], check=True, capture_output=True)


def try_(
    during: Callable[[], object] | None = None, before: Callable[[], object] | None = None, seconds: float = 1.5
) -> dict[str, object]:
    """Open, read; `during` happens after 0.4 s. what: the loss, in words; after_s: since `during`."""
    told: dict[str, object] = {"frames": 0, "silent": 0, "what": None}
    happened_s = None
    try:
        if before:
            before()
        with open_video(f"{NODE}&format=GREY", CLOCK) as source:
            began_s = time.monotonic()
            while time.monotonic() - began_s < seconds:
                if during and happened_s is None and time.monotonic() - began_s > 0.4:
                    happened_s = time.monotonic()
                    during()
                frame = source.read(0.3)
                told["frames" if frame else "silent"] += 1
                told |= {"damaged": source.damaged, "remarks": source.describe().remarks}
                if frame:
                    told["err_ms"] = frame.stamp.err_ns / 1e6
    except DeviceLost as loss:
        told["what"] = loss.what
        told["after_s"] = None if happened_s is None else round(time.monotonic() - happened_s, 2)
    return told


def faults() -> dict[str, dict[str, object]]:
    """Each of vivid's own faults, and whether the next opening works."""
    found = {"healthy": try_()}
    for name, settings in {
        "damaged": {"inject_v4l2_buf_flag_error": 1},
        "queue": {"inject_vidioc_qbuf_error": 1},
        "fatal": {"inject_fatal_streaming_error": 1},
        "disconnect": {"disconnect": 1},
    }.items():
        found[name] = try_(during=lambda settings=settings: control(**settings))
        time.sleep(0.3)
        found[f"after {name}"] = try_(seconds=0.7)
    for name, settings in {
        "no buffers": {"inject_vidioc_reqbufs_error": 1},
        "no start": {"inject_vidioc_streamon_error": 1},
    }.items():
        found[name] = try_(before=lambda settings=settings: control(**settings))
    for name, mode in (("no signal", 1), ("no lock", 2), ("out of range", 3)):
        found[name] = try_(during=lambda mode=mode: control(dv_timings_signal_mode=mode))
        found[f"still {name}"] = try_(seconds=0.3)
        control(dv_timings_signal_mode=0)
        found[f"after {name}"] = try_(seconds=0.7)
    for name, settings, back in (
        ("lossy", {"percentage_of_dropped_buffers": 30}, {"percentage_of_dropped_buffers": 0}),
        ("sequence wraps", {"wrap_sequence_number": 1}, {"wrap_sequence_number": 0}),
        ("time wraps", {"wrap_timestamp": 1}, {"wrap_timestamp": 0}),
        ("end of frame", {"timestamp_source": 0}, {"timestamp_source": 1}),
    ):
        found[name] = try_(before=lambda settings=settings: control(**settings))
        control(**back)
    with open_video(f"{NODE}&format=GREY", CLOCK):
        found["busy"] = try_()
    found["unbound"] = try_(during=lambda: (DRIVER / "unbind").write_text("vivid.0"))
    found["still unbound"] = try_(seconds=0.3)
    (DRIVER / "bind").write_text("vivid.0")
    subprocess.run(["udevadm", "settle"], check=False)
    found["after unbound"] = try_(seconds=0.7)
    return found


if __name__ == "__main__":
    if sys.argv[1] == "exact":
        print(json.dumps(exact(sys.argv[2], float(sys.argv[3]))))
    else:
        print(json.dumps(faults()))
