"""Events in long recordings and live streams: what was done when."""
