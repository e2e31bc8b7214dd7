"""The compiled part of the core: `levels.c`, `points.c` and `descent.c`."""

import ctypes
from typing import Any

import cv2
import numpy as np

_CPU_AVX2 = 11
"""OpenCV's number for it, cv::CpuFeatures."""


def declared(name: str, *arguments: Any, result: Any = None) -> Any:
    """A compiled function by its name."""
    function = getattr(_library, name)
    function.argtypes, function.restype = arguments, result
    return function


try:
    _name = "_compiled_avx2" if cv2.checkHardwareSupport(_CPU_AVX2) else "_compiled"
    _library: ctypes.CDLL = np.ctypeslib.load_library(_name, __file__)
except OSError as missing:
    raise ImportError(f"{missing}: the core is not compiled for this machine; `make .venv/dev` does that") from missing
