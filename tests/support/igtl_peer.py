"""`python -m tests.support.igtl_peer serve|listen PORT SECONDS`: pyigtl, a public library, as the other side.

A process of its own, because its server takes over the signals of the one it runs in.
"""

import json
import sys
import time

import numpy as np
import pyigtl


def _pose(number: int) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    matrix[:3, 3] = number, 20.0, -1600.0
    return matrix


def serve(port: int, seconds: float) -> None:
    """A picture whose grey is its number, and a transform whose x is; besides, the other types that it knows."""
    server = pyigtl.OpenIGTLinkServer(port=port, local_server=True)
    print(json.dumps({"ready": True}), flush=True)
    end_s, number = time.monotonic() + seconds, 0
    while time.monotonic() < end_s:
        if server.is_connected():
            pixels = np.full((1, 48, 64), number % 200, np.uint8)
            server.send_message(pyigtl.ImageMessage(pixels, device_name="Image"), wait=False)
            transform = pyigtl.TransformMessage(_pose(number), device_name="ProbeToTracker")
            if number % 2:
                transform.header_version = 2
                transform.metadata = {"TransformStatus": "OK"}
            server.send_message(transform, wait=False)
            server.send_message(pyigtl.StringMessage("a note", device_name="Note"), wait=False)
            server.send_message(pyigtl.PointMessage([1.0, 2.0, 3.0], device_name="Point"), wait=False)
            turned = pyigtl.PositionMessage([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0], device_name="Position")
            server.send_message(turned, wait=False)
            number += 1
        time.sleep(0.02)


def listen(port: int, seconds: float) -> None:
    """Prints what of each device came last."""
    client = pyigtl.OpenIGTLinkClient("127.0.0.1", port)
    end_s, last = time.monotonic() + seconds, {}
    while time.monotonic() < end_s:
        for message in client.get_latest_messages():
            last[message.device_name] = message
        time.sleep(0.02)
    said = {}
    for name, message in last.items():
        value = {
            "TRANSFORM": lambda message=message: message.matrix.tolist(),
            "STRING": lambda message=message: message.string,
            "IMAGE": lambda message=message: [list(message.image.shape), float(message.image.mean())],
        }[message.message_type]()
        said[name] = {"type": message.message_type, "value": value, "version": message.header_version}
        if message.message_type == "IMAGE":
            said[name]["place"] = message.ijk_to_world_matrix.tolist()
    client.stop()
    print(json.dumps(said), flush=True)


if __name__ == "__main__":
    {"serve": serve, "listen": listen}[sys.argv[1]](int(sys.argv[2]), float(sys.argv[3]))
