"""V4L2 capture: abi (the kernel's structures), node, negotiation, stream, stamps, pixels, and source, the device."""
