"""Recognises what is no film although OpenCV opens it."""

import cv2

_DRAWN_TEXT = int.from_bytes(b"ansi", "little")
"""Codec with which FFmpeg draws the text of a file called .txt, .nfo, .asc or the like, line by line."""


def why_no_film(capture: cv2.VideoCapture, unreadable: str, remedy: str) -> tuple[str, str] | None:
    """Returns (what is wrong, what to do) for a source that gives no pictures of a scanner; None where it may give
    some. unreadable, remedy: the answer for one that OpenCV has not opened.
    """
    if not capture.isOpened():
        return unreadable, remedy
    if round(capture.get(cv2.CAP_PROP_FOURCC)) == _DRAWN_TEXT:
        capture.release()
        return "is text, which would be drawn as pictures", "Give the film itself"
    return None
