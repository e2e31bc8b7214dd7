"""Runs the estimator process. process_host starts it with `-m probewatch.appliance.service.estimator.process FD…`;
loop.serve reads the descriptors.
"""

import sys

import cv2

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.warm_up import warm_up
from probewatch.appliance.service.estimator.loop import serve
from probewatch.appliance.service.host.resident_memory import keep_what_is_loaded, lock_memory

if __name__ == "__main__":
    cv2.setNumThreads(1)
    lock_memory()
    warm_up()
    keep_what_is_loaded()
    serve(sys.argv[1:], Line)
