"""The service's status as it gives it over its control socket."""

import json
import socket

with socket.socket(socket.AF_UNIX) as line:
    line.settimeout(20)
    line.connect("/run/probewatch/control")
    line.sendall(b'{"v": 1, "do": "status"}\n')
    print(json.dumps(json.loads(line.makefile().readline())["status"]))
