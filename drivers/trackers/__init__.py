"""Sources of poses, one folder a protocol. At this level the geometry that all trackers share."""
