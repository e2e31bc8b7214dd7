"""The process that computes. appliance.estimator_host starts it: `-m appliance.estimator_process LINK FRAMES POSES`."""

import sys

import cv2

from appliance.estimator_loop import serve
from appliance.line import Line

if __name__ == "__main__":
    cv2.setNumThreads(1)
    serve(sys.argv[1:], Line)
