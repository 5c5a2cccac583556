"""What pose backends share: letterboxing, decoding of heat maps, tracks, gap filling, model files."""
