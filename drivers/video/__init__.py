"""Holds the sources of pictures, one file or folder per scheme, and what cuts a picture out and turns it.

DRIVERS describes each of them and can be read without importing the drivers (drivers/descriptor.py).
"""

from probewatch.drivers.descriptor import CAMERA, FILM, SOCKET, STREAM, VIDEO_NODE, Driver, Option, Twin
from probewatch.drivers.video.crop import CROP, ORIENTATION

_FORMATS = (
    *("GREY", "NV12", "YU12", "YV12", "YUYV", "YVYU", "UYVY"),
    *("RGB3", "BGR3", "XR24", "MJPG", "JPEG"),
)
"""V4L2's codes of the pixels that `v4l2/pixels.py` makes grey; grabbers for scanners offer one of them, as far as is
known. Each more is a few lines there.
"""
_RATES_HZ, _INPUTS = (1, 1000), (0, 63)
"""Rates, Hz, and inputs that a URL may request of a grabber. They only refuse typing errors; the device refuses
everything else. No grabber has more inputs.
"""
_DELAYS_MS = (0, 5000)
"""Range of delay_ms= and error_ms=. More is a slip of the decimal point: a picture that is 5 s late serves no check."""

V4L2 = Driver(
    "v4l2",
    "probewatch.drivers.video.v4l2.source",
    "frame grabbers and cameras that the kernel knows",
    "kernel's V4L2",
    {"video": "v4l2:/dev/video0"},
    (VIDEO_NODE,),
    (
        CROP,
        Option("format", "of the pixels", "by the device", words=_FORMATS, refusal="is not understood"),
        Option(
            "input", "number of the device's input", "as it is", bounds=_INPUTS, refusal="is not the number of an input"
        ),
        ORIENTATION,
        Option("rate", "of the pictures", "by the device", "Hz", _RATES_HZ, refusal="is not a picture rate"),
        Option("size", "of the pictures, px", "by the device", form="WIDTHxHEIGHT", refusal="is not a picture size"),
    ),
    is_listed=True,
)
OPENCV = Driver(
    "opencv",
    "probewatch.drivers.video.opencv",
    "streams, films and cameras that OpenCV reads",
    "network, file",
    {"video": "opencv:rtsp://host/stream"},
    (STREAM, FILM, CAMERA),
    (
        CROP,
        Option(
            "delay_ms",
            "that is known to pass between picture and arrival",
            "0",
            "ms",
            _DELAYS_MS,
            refusal="is not a time",
        ),
        Option("error_ms", "by which that may be wrong", "100", "ms", _DELAYS_MS, refusal="is not a time"),
        ORIENTATION,
    ),
    advice="; write %3F for a question mark in the address",
)
SIM = Driver(
    "sim",
    "probewatch.drivers.video.sim",
    "simulated scanners",
    "Unix socket",
    {"video": "sim:/run/scanner"},
    (SOCKET,),
    twin=Twin("scanner", "a scanner's video output on a Unix socket"),
    is_simulated=True,
)
DRIVERS = (V4L2, OPENCV, SIM)
