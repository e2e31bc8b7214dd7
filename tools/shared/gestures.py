"""Which motion of the probe shows what: the words for a person whose scan has shown too little."""

GESTURES = {
    "polarity": "slide sideways and press, to and fro",
    "latency": "move to and fro, briskly",
    "scale-lateral": "slide sideways, to and fro",
    "scale-axial": "press and release",
    "rotation-lateral": "slide along the probe's length and press",
    "rotation-axial": "slide sideways with a slow sweep",
    "rotation-elevational": "slide sideways and press, in turns",
    "offset-lateral": "rock the probe sideways about one place",
    "offset-axial": "rock the probe sideways about one place",
    "offset-elevational": "tilt to and fro while you slide",
}
"""Name of a check → motion."""
