"""The structures of drivers.video.v4l2.abi against what the compiler makes of the kernel's own header."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import pytest

from probewatch.drivers.video.v4l2 import abi

HEADER = Path("/usr/include/linux/videodev2.h")
pytestmark = pytest.mark.skipif(
    shutil.which("gcc") is None or not HEADER.exists(), reason="needs gcc and the kernel's header linux/videodev2.h"
)

FIELDS: dict[str, tuple[type[ctypes.Structure], dict[str, str]]] = {
    "v4l2_capability": (abi.Capability, {"card": "card", "device_caps": "device_caps"}),
    "v4l2_fmtdesc": (abi.FmtDesc, {"pixelformat": "pixelformat", "mbus_code": "mbus_code"}),
    "v4l2_format": (abi.Format, {"pix": "fmt.pix"}),
    "v4l2_pix_format": (abi.PixFormat, {"field": "field", "bytesperline": "bytesperline", "xfer_func": "xfer_func"}),
    "v4l2_requestbuffers": (abi.RequestBuffers, {"memory": "memory", "flags": "flags"}),
    "v4l2_buffer": (
        abi.Buffer,
        {
            "flags": "flags",
            "timestamp_s": "timestamp.tv_sec",
            "timestamp_us": "timestamp.tv_usec",
            "sequence": "sequence",
            "memory": "memory",
            "offset": "m.offset",
            "length": "length",
            "request_fd": "request_fd",
        },
    ),
    "v4l2_streamparm": (
        abi.StreamParm,
        {
            "capability": "parm.capture.capability",
            "numerator": "parm.capture.timeperframe.numerator",
            "denominator": "parm.capture.timeperframe.denominator",
        },
    ),
    "v4l2_input": (abi.Input, {"std": "std", "status": "status", "capabilities": "capabilities"}),
    "v4l2_dv_timings": (
        abi.DvTimings,
        {"width": "bt.width", "pixelclock": "bt.pixelclock", "hsync": "bt.hsync", "vbackporch": "bt.vbackporch"},
    ),
    "v4l2_event": (abi.Event, {"u": "u", "timestamp_s": "timestamp.tv_sec", "id": "id"}),
    "v4l2_event_subscription": (abi.EventSubscription, {"flags": "flags"}),
}
REQUESTS = tuple(
    name
    for line in (
        "QUERYCAP ENUM_FMT G_FMT S_FMT REQBUFS QUERYBUF QBUF DQBUF STREAMON STREAMOFF G_PARM S_PARM ENUMINPUT",
        "G_INPUT S_INPUT S_DV_TIMINGS G_DV_TIMINGS QUERY_DV_TIMINGS DQEVENT SUBSCRIBE_EVENT",
    )
    for name in line.split(" ")
)
CONSTANTS = [name for name in vars(abi) if name.startswith(("BUF_", "CAP_", "EVENT_", "FIELD_", "IN_", "MEMORY_"))]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> dict[str, int]:
    """What the compiler says: expression → number."""
    sizes = [f"sizeof(struct {name})" for name in FIELDS]
    offsets = [f"offsetof(struct {name}, {c})" for name, (_, fields) in FIELDS.items() for c in fields.values()]
    constants = [_c_name(name) for name in CONSTANTS]
    expressions = [*sizes, *offsets, *constants, *(f"VIDIOC_{name}" for name in REQUESTS)]
    folder = tmp_path_factory.mktemp("abi")
    lines = "".join(f'printf("%llu\\n", (unsigned long long)({one}));\n' for one in expressions)
    head = "#include <stdio.h>\n#include <stddef.h>\n#include <linux/videodev2.h>\n"
    (folder / "abi.c").write_text(f"{head}int main(void) {{\n{lines}return 0;\n}}\n")
    subprocess.run(["gcc", "-o", folder / "abi", folder / "abi.c"], check=True)
    said = subprocess.run([folder / "abi"], check=True, capture_output=True, text=True).stdout.split()
    return dict(zip(expressions, map(int, said), strict=True))


def _c_name(name: str) -> str:
    return f"V4L2_{name}"


@pytest.mark.parametrize("name", FIELDS)
def test_layout(name: str, compiled: dict[str, int]) -> None:
    kind, fields = FIELDS[name]
    assert ctypes.sizeof(kind) == compiled[f"sizeof(struct {name})"]
    for ours, theirs in fields.items():
        assert getattr(kind, ours).offset == compiled[f"offsetof(struct {name}, {theirs})"], ours


def test_request_numbers_and_constants(compiled: dict[str, int]) -> None:
    assert {name: getattr(abi, name) for name in REQUESTS} == {name: compiled[f"VIDIOC_{name}"] for name in REQUESTS}
    assert len(CONSTANTS) > 15
    for name in CONSTANTS:
        assert getattr(abi, name) == compiled[_c_name(name)], name


def test_every_request_of_the_driver_is_compared() -> None:
    numbers = {name for name, value in vars(abi).items() if isinstance(value, int) and name.isupper()}
    ours = {name for name in numbers if not name.startswith("_")}
    assert ours - set(CONSTANTS) == set(REQUESTS)
