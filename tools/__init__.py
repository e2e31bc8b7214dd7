"""What people type: the demo, replay, recalibration and the service command."""
