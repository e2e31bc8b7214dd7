"""The process that computes, started by estimator_host: `-m appliance.service.estimator_process LINK FRAMES POSES`."""

import sys

import cv2

from appliance.core.line import Line
from appliance.service.estimator_loop import serve

if __name__ == "__main__":
    cv2.setNumThreads(1)
    serve(sys.argv[1:], Line)
