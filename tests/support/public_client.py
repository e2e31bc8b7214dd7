"""`python -m tests.support.public_client KIND …`: reads poses with a public NDI client and prints them as JSON.

A process of its own, because these clients wait in C without a time limit, and one of them has been seen to crash.
"""

import json
import sys
from collections.abc import Iterator
from typing import Any

READINGS = 30


def _raw(command: str, port: str, *roms: str) -> Iterator[dict[str, Any]]:
    """ndicapi: TX or BX through a serial port."""
    import ndicapy  # noqa: PLC0415  a test-only dependency

    assert ndicapy.ndiProbe(port) == ndicapy.NDI_OKAY
    device = ndicapy.ndiOpen(port)
    for request in ("INIT:", "COMM:50000"):
        assert ndicapy.ndiCommand(device, request) == "OKAY", request
    handles = []
    for rom in roms:
        ndicapy.ndiCommand(device, "PHRQ:*********1****")
        handle = ndicapy.ndiGetPHRQHandle(device)
        ndicapy.ndiPVWRFromFile(device, handle, rom)
        for request in (f"PINIT:{handle:02X}", f"PENA:{handle:02X}D"):
            assert ndicapy.ndiCommand(device, request) == "OKAY", request
        handles.append(handle)
    assert ndicapy.ndiCommand(device, "TSTART:") == "OKAY"
    get_transform = getattr(ndicapy, f"ndiGet{command}Transform")
    get_frame = getattr(ndicapy, f"ndiGet{command}Frame")
    for _ in range(READINGS):
        ndicapy.ndiCommand(device, f"{command}:0801")
        assert ndicapy.ndiGetError(device) == ndicapy.NDI_OKAY
        for handle in handles:
            name = bytes([handle])
            q0, qx, qy, qz, *rest = get_transform(device, name)
            yield {"handle": handle, "frame": get_frame(device, name), "q": [q0, qx, qy, qz], "t": rest[:3]}
    assert ndicapy.ndiCommand(device, "TSTOP:") == "OKAY"
    ndicapy.ndiClose(device)


def _scikit(settings: str) -> Iterator[dict[str, Any]]:
    """scikit-surgerynditracker, with its own settings as JSON."""
    from sksurgerynditracker.nditracker import NDITracker  # noqa: PLC0415  a test-only dependency

    tracker = NDITracker(json.loads(settings) | {"use quaternions": True})
    tracker.start_tracking()
    for _ in range(READINGS):
        handles, _, frames, tracking, _ = tracker.get_frame()
        for handle, frame, pose in zip(handles, frames, tracking, strict=True):
            values = pose.reshape(7).tolist()
            yield {"handle": handle, "frame": int(frame), "q": values[:4], "t": values[4:]}
    tracker.stop_tracking()
    tracker.close()


if __name__ == "__main__":
    kind, *arguments = sys.argv[1:]
    readings = _scikit(*arguments) if kind == "scikit" else _raw(kind, *arguments)
    print(json.dumps(list(readings)))
