"""GStreamer's RTSP server with a test picture, ten a second, at /live: `/usr/bin/python3 rtsp_server.py PORT`.

It runs with the system's Python and Debian's gir1.2-gst-rtsp-server-1.0, python3-gi and gstreamer1.0-plugins-good.
"""

import sys

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer  # noqa: E402  versions are chosen first

CAPS = "video/x-raw,format=I420,width=320,height=240,framerate=10/1"
LAUNCH = f"( videotestsrc is-live=true ! {CAPS} ! jpegenc ! rtpjpegpay name=pay0 )"

Gst.init(None)
server = GstRtspServer.RTSPServer()
server.set_address("127.0.0.1")
server.set_service(sys.argv[1])
factory = GstRtspServer.RTSPMediaFactory()
factory.set_shared(True)
factory.set_launch(LAUNCH)
server.get_mount_points().add_factory("/live", factory)
server.attach(None)
print("ready", flush=True)
GLib.MainLoop().run()
