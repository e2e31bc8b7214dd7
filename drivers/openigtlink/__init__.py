"""OpenIGTLink, the network protocol of PLUS and 3D Slicer: its messages, the stream that they come in, and what one
server can be: a source of pictures and a source of poses.
"""
