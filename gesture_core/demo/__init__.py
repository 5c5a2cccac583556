"""A small archive that the package draws itself: people of flat shapes who perform gestures."""
