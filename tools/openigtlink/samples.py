"""Converts pictures and poses of the service to IMAGE and TRANSFORM, with the time at which they were true. Pure."""

from probewatch.drivers.openigtlink.content import transform_content
from probewatch.drivers.openigtlink.image import Image
from probewatch.drivers.openigtlink.message import UTF_8, Entry, Message, time_of
from probewatch.drivers.samples import Frame, Pose
from probewatch.tools.openigtlink.asked import Names

_NUMBERS = 1 << 32
"""Number of different message numbers, by the specification."""


def sample_message(sample: Frame | Pose, names: Names, utc_ns: int, version: int, simulated: bool) -> Message:
    """Returns the message of a picture or a pose; a pose must have a matrix. utc_ns: nanoseconds since 1970 UTC at
    CLOCK_MONOTONIC 0.
    """
    if isinstance(sample, Frame):
        kind, device, content = "IMAGE", names.image, _picture(sample)
    else:
        assert sample.matrix is not None
        kind, device, content = "TRANSFORM", names.pose, transform_content(sample.matrix)
    time = time_of(sample.stamp.t_ns + utc_ns)
    if version == 1:
        return Message(kind, device, content, time)
    return Message(kind, device, content, time, version, sample.sequence % _NUMBERS, _metadata(sample, simulated))


def _picture(frame: Frame) -> bytes:
    """Returns the content of IMAGE. The axes are columns and rows, in pixels, with the middle of the first pixel at the
    origin, so that ImageToProbe belongs before it. The message places a picture by its middle.
    """
    rows, columns = frame.image.shape
    matrix = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, (columns - 1) / 2, (rows - 1) / 2, 0.0)
    return Image((columns, rows, 1), frame.image.tobytes(), matrix=matrix).content


def _metadata(sample: Frame | Pose, simulated: bool) -> tuple[Entry, ...]:
    told = {
        "FrameNumber": str(sample.sequence),
        "TimeErrorS": f"{sample.stamp.err_ns / 1e9:.6f}",
        "Simulated": str(simulated).lower(),
    }
    if isinstance(sample, Pose):
        told["TransformStatus"] = sample.status.name
    return tuple((key, UTF_8, value) for key, value in told.items())
