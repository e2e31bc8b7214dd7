"""Loads the compiled part of the core: `levels.c`, `points.c`, `descent.c` and `conclusion.c`."""

import ctypes
from typing import Any

import cv2
import numpy as np

_CPU_AVX2 = 11
"""OpenCV's number of this feature of a processor, cv::CpuFeatures."""


def unusable(why: object) -> ImportError:
    """Returns the error to raise where the library is missing, or was not compiled from this source."""
    return ImportError(
        f"the compiled core {_NAME} cannot be used: {why}. `make -B .venv/dev` compiles it again for this machine; "
        "where probewatch came as a package, install the one of this machine's architecture again"
    )


def declared(name: str, *arguments: Any, result: Any = None) -> Any:
    """Returns a compiled function by its name. Raises ImportError where the library does not have it."""
    try:
        function = getattr(_library, name)
    except AttributeError as missing:
        raise unusable(missing) from missing
    function.argtypes, function.restype = arguments, result
    return function


_NAME = "_compiled_avx2" if cv2.checkHardwareSupport(_CPU_AVX2) else "_compiled"
try:
    _library: ctypes.CDLL = np.ctypeslib.load_library(_NAME, __file__)
    LAYOUT = tuple((ctypes.c_int32 * 7).in_dll(_library, "layout"))
    """PARAMETERS, CELLS, SUMS and LOOKS of compiled.h; the sizes of Level, Template and Fit in bytes."""
except (OSError, ValueError) as missing:
    raise unusable(missing) from missing
