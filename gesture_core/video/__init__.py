"""Probing and decoding videos: frames with their real timestamps, damage counted.

`reader.open_video` opens one: `sniff` opens the file and tells its container from its first bytes,
`pyav_source` or `opencv_source` decodes it, `clock` makes its stamps seconds, `upright` turns its
pictures. What is lost on the way is told to an `info.Ledger`: by FFmpeg (`pyav_ear`), by counts at the
end (`account`), and by the structure of an mp4 (`boxes`, `fragments`, `edits`) or Matroska file (`elements`).
"""
